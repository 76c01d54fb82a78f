"""All that is fuzzed in Python: a target takes any bytes, and fails where they break a promise.

`python -m tests.fuzz.run TARGET` searches for such bytes by coverage; `tests/property/test_fuzz.py` repeats the corpus.
"""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

FOLDER = Path(__file__).parent
IN_FILES = {  # each imports much
    "wires": ("framing", "messages", "master", "mqtt"),
    "files": ("dbc", "can_log", "csv", "profile", "session"),
    "requests": ("http",),
}
TARGETS = {name: f"tests.fuzz.{file}" for file, names in IN_FILES.items() for name in names}


def target(name: str) -> Callable[[bytes], None]:
    """Return a target by its name."""
    found: Callable[[bytes], None] = getattr(import_module(TARGETS[name]), name)
    return found


def kept(name: str) -> list[Path]:
    """Return what is kept of a target: inputs that reach different code, and those that once broke it."""
    return sorted(path for part in ("corpus", "finds") for path in (FOLDER / part / name).glob("*"))
