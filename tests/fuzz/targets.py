"""All that is fuzzed in Python: a target takes any bytes, and fails where they break a promise.

`python -m tests.fuzz.run TARGET` searches for such bytes by coverage; `tests/property/test_fuzz.py` repeats the corpus.
"""

from collections.abc import Callable
from pathlib import Path

from tests.fuzz import files, requests, wires

FOLDER = Path(__file__).parent
TARGETS: dict[str, Callable[[bytes], None]] = {
    "framing": wires.framing,
    "messages": wires.messages,
    "master": wires.master,
    "mqtt": wires.mqtt,
    "dbc": files.dbc,
    "can_log": files.can_log,
    "csv": files.csv,
    "profile": files.profile,
    "session": files.session,
    "http": requests.http,
}


def kept(name: str) -> list[Path]:
    """Return what is kept of a target: inputs that reach different code, and those that once broke it."""
    return sorted(path for part in ("corpus", "finds") for path in (FOLDER / part / name).glob("*"))
