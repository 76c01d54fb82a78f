"""The frames of a log in the order of their times, in constant memory: what is too much for it waits in a file."""

import marshal
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from heapq import heapify, heappop, heapreplace
from operator import itemgetter
from pathlib import Path

from app.sources.recordings.can_log import Frame

RUN = 100_000  # frames that are sorted in memory
_BLOCK = 2_000  # frames that are read back at once
_IN_MEMORY = 16 << 20  # bytes; of a short log, nothing goes to the disk


@dataclass(frozen=True, slots=True)
class _Run:
    """Frames that stand in order: the time of the first one, and the place and size of each block."""

    first_s: float
    blocks: list[tuple[int, int]]


class FrameSpool:
    """Takes frames in any order and gives them back by time; those of one time in the order in which they came."""

    def __init__(self, folder: Path, run: int = RUN) -> None:
        """Begin without frames.

        Args:
            folder: where there is room for them; nothing is left in it.
            run: how many are sorted in memory.
        """
        self._file = tempfile.SpooledTemporaryFile(_IN_MEMORY, dir=str(folder))  # noqa: SIM115  closed by close
        self._run = run
        self._runs: list[_Run] = []
        self._waiting: list[Frame] = []
        self.n = 0  # frames
        self.last_s = float("-inf")

    def close(self) -> None:
        """Forget the frames."""
        self._file.close()

    @property
    def first_s(self) -> float:
        """Time of the first frame; of no frames 0."""
        self._end_run()
        return min((run.first_s for run in self._runs), default=0.0)

    def add(self, frame: Frame) -> None:
        """Take a frame.

        Raises:
            OSError: the disk does not take it.
        """
        self._waiting.append(frame)
        self.n += 1
        if len(self._waiting) >= self._run:
            self._end_run()

    def _end_run(self) -> None:
        if not self._waiting:
            return
        self._waiting.sort(key=itemgetter(0))
        run = _Run(self._waiting[0][0], [])
        self.last_s = max(self.last_s, self._waiting[-1][0])
        self._file.seek(0, 2)
        for start in range(0, len(self._waiting), _BLOCK):
            block = marshal.dumps(self._waiting[start : start + _BLOCK])
            run.blocks.append((self._file.tell(), len(block)))
            self._file.write(block)
        self._runs.append(run)
        self._waiting = []

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames by time; a run is open only while its frames are due, so that few are at once."""
        self._end_run()
        waiting = sorted(range(len(self._runs)), key=lambda number: self._runs[number].first_s)[::-1]
        due: list[tuple[float, int, Frame, Iterator[Frame]]] = []  # the next frame of each open run
        while due or waiting:
            while waiting and (not due or self._runs[waiting[-1]].first_s <= due[0][0]):
                number = waiting.pop()
                frames = self._frames_of(self._runs[number])
                frame = next(frames)
                due.append((frame[0], number, frame, frames))
                heapify(due)
            _, number, frame, frames = due[0]
            yield frame
            following = next(frames, None)
            if following is None:
                heappop(due)
            else:
                heapreplace(due, (following[0], number, following, frames))

    def _frames_of(self, run: _Run) -> Iterator[Frame]:
        for at, size in run.blocks:
            self._file.seek(at)
            yield from marshal.loads(self._file.read(size))
