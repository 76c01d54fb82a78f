"""The command line of a process that runs a module of ours.

With `-m` alone Python looks for modules in the working folder first: a file `can.py` there would be run in place of
python-can. `-P` turns that off; the folder of this package is named instead.
"""

import sys
from pathlib import Path
from typing import Final

_RUN: Final = (
    "import runpy, sys; folder, module = sys.argv[1:3]; del sys.argv[1:3]; "
    "folder in sys.path or sys.path.insert(0, folder); runpy.run_module(module, run_name='__main__', alter_sys=True)"
)


_ABOVE: Final = __name__.removesuffix("app.sessions.worker.child_process")  # in a wheel `voltwall.`
_FOLDER: Final = Path(__file__).resolve().parents[3 + _ABOVE.count(".")]


def our_module(name: str) -> str:
    """Return what a module of the checkout, as `app.cli`, is called where this one was imported from."""
    return _ABOVE + name


def command_of(module: str, *arguments: str) -> list[str]:
    """Return the command line that runs a module as a program of its own, whatever lies in the working folder."""
    return [sys.executable, "-P", "-c", _RUN, str(_FOLDER), our_module(module), *arguments]
