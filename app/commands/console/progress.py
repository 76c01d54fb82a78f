"""How far a job has come, on the terminal: per cent and the time left, as soon as it takes longer than a moment."""

import sys
import time

SHOWN_AFTER_S = 2.0
EVERY_S = 0.2


class Progress:
    """One line on standard error that is written over; nothing where that is no terminal."""

    last: "Progress | None" = None  # whose line stands on the terminal

    def __init__(self, what: str = "", *, shows: bool = True) -> None:
        """Begin to count the time of the job.

        Args:
            what: stands before the numbers.
            shows: False: nothing at all, for a job that runs by itself.
        """
        self._what = f"{what} " if what else ""
        self._shows = shows and sys.stderr.isatty()
        self._started_s = time.monotonic()
        self._shown_s = self._started_s + SHOWN_AFTER_S - EVERY_S
        self._is_shown = False

    def __call__(self, done: int, of: int) -> None:
        """Tell that so many of so many parts are done."""
        now_s = time.monotonic()
        if not self._shows or now_s < self._shown_s + EVERY_S:
            return
        self._shown_s, self._is_shown, Progress.last = now_s, True, self
        left_s = (now_s - self._started_s) * (of - done) / max(done, 1)
        text = f"{self._what}{100 * done / max(of, 1):5.1f} %, {time_left(left_s)} left"
        print(f"\r{text:<60}", end="", file=sys.stderr, flush=True)

    def end(self) -> None:
        """Leave the line free for what follows."""
        if self._is_shown:
            print(f"\r{'':<60}\r", end="", file=sys.stderr, flush=True)
            self._is_shown = False


def leave_no_line() -> None:
    """Take a line away whose job did not get to its end, for what is said next."""
    if Progress.last is not None:
        Progress.last.end()


def time_left(seconds: float) -> str:
    """Return a duration as a person says it: 8 s, 3 min, 2 h 5 min."""
    if seconds < 60.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"
