"""Searches by coverage for bytes that break a target: `python -m tests.fuzz.run TARGET [SECONDS]`, with atheris.

What reaches new code is kept in the folder that VOLTWALL_FUZZ names, else thrown away. A find is written there and ends
the search with an error.
"""

import os
import sys
import tempfile
from pathlib import Path

import app  # noqa: F401  before numpy: it keeps each process to one thread

LONGEST = 4096  # bytes of an input
SHORT_S = 60.0  # a shorter search begins with the same inputs each time: it judges a change, and does not look for news


def main(name: str, seconds: float) -> None:
    """Search; ends the process."""
    import atheris

    with atheris.instrument_imports(include=["app", "firmware_protocol"], enable_loader_override=False):
        from tests.fuzz.targets import FOLDER, target

        tried = target(name)

    found = Path(os.environ.get("VOLTWALL_FUZZ") or tempfile.mkdtemp(prefix="voltwall-fuzz-")) / name
    corpus = FOLDER / "corpus" / name
    for folder in (found, corpus, FOLDER / "finds" / name):
        folder.mkdir(parents=True, exist_ok=True)
    options = [f"-max_len={LONGEST}", f"-max_total_time={int(seconds)}", "-timeout=30", "-rss_limit_mb=3000"]
    options += [f"-artifact_prefix={found.parent}/{name}-", "-print_final_stats=1"]
    options += ["-seed=1"] * (seconds < SHORT_S)
    folders = [str(found), str(corpus), str(FOLDER / "finds" / name)]
    atheris.Setup([sys.argv[0], *options, *folders], tried)
    atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]) if len(sys.argv) > 2 else 60.0)
