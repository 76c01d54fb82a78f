"""All that is fuzzed in Python: a target takes any bytes, and fails where they break a promise.

`python -m tests.fuzz.run TARGET` searches for such bytes by coverage; `tests/property/test_fuzz.py` repeats the corpus.
"""

import signal
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

FOLDER = Path(__file__).parent
INPUT_S = 5.0  # processor time for an input of at most 4 KiB; the first of a kind imports its library
IN_FILES = {  # each imports much
    "wires": ("framing", "messages", "master", "mqtt"),
    "files": ("dbc", "can_log", "csv", "profile", "session"),
    "requests": ("http",),
}
TARGETS = {name: f"tests.fuzz.{file}" for file, names in IN_FILES.items() for name in names}


class TooSlow(BaseException):
    """An input took longer than it may; no handler of mere errors keeps it."""


def target(name: str) -> Callable[[bytes], None]:
    """Return a target by its name; an input that takes longer than INPUT_S breaks it."""
    found: Callable[[bytes], None] = getattr(import_module(TARGETS[name]), name)
    found(b"")  # makes what every input needs
    return limited(found)


def limited(tried: Callable[[bytes], None], seconds: float = INPUT_S) -> Callable[[bytes], None]:
    """Return a function that raises TooSlow where `tried` takes more processor time; in the main thread alone.

    A regular expression that turns in circles is interrupted, too: Python's looks for signals meanwhile.
    """
    if not hasattr(signal, "setitimer"):  # Windows
        return tried

    def run(data: bytes) -> None:
        before = signal.signal(signal.SIGPROF, _too_slow)
        signal.setitimer(signal.ITIMER_PROF, seconds)
        try:
            tried(data)
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
            signal.signal(signal.SIGPROF, before)

    return run


def _too_slow(*_: object) -> None:
    raise TooSlow


def kept(name: str) -> list[Path]:
    """Return what is kept of a target: inputs that reach different code, and those that once broke it."""
    return sorted(path for part in ("corpus", "finds") for path in (FOLDER / part / name).glob("*"))
