"""Finds, checks and opens a shared library made of C sources, as `hatch_build.py` builds them."""

import ctypes
import hashlib
import sys
from collections.abc import Iterable
from pathlib import Path

from firmware_protocol.errors import LibraryError

C_FOLDER = Path(__file__).with_name("c")
SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")


def sources_digest(sources: Iterable[Path]) -> str:
    """Return the SHA-256 of C sources, which their library carries; `hatch_build.py` computes the same."""
    return hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()


def open_library(path: Path, sources: Iterable[Path]) -> ctypes.PyDLL:
    """Return the library at a path.

    Raises:
        LibraryError: there is none for this machine, or it was built from other sources than these.
    """
    if not path.is_file():
        raise LibraryError(
            f"the library {path.name} is missing: install voltwall again, or in a checkout run"
            " python hatch_build.py engine"
        )
    try:
        library = ctypes.PyDLL(str(path))  # a call is short; another thread may wait for it
    except OSError as error:
        raise LibraryError(f"{path.name} cannot be loaded: {error}") from error
    library.vw_library_sources.restype = ctypes.c_char_p
    if library.vw_library_sources().decode() != sources_digest(sources):
        raise LibraryError(f"{path.name} was built from other sources than these: run python hatch_build.py engine")
    return library
