"""Machine code of the kernels: compiled once by another process, kept on disk, loaded without numba.

numba takes 120 MB and seconds; what it has compiled takes a few and runs alone. Only its back end, llvmlite, is loaded
to place the code into memory. A file is known by everything it depends on: this package, the versions of numba and
llvmlite, the processor, the shape.
"""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import importlib.metadata
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, Final

import platformdirs
from filelock import FileLock

from app.estimation.errors import EstimatorError
from app.estimation.filters.compiled.shape import Shape

# mypy: disable-error-code="no-untyped-call"

COMPILE_S: Final = 300.0  # longer than the slowest of pit laptops takes
ENTRY: Final = "voltwall_kernel"
LIBRARY_CALLS: Final = frozenset({"exp", "asinh", "sqrt", "memset", "memcpy", "memmove"})
_POINTER: Final = ctypes.c_void_p
_ARGUMENTS: Final = {
    "step": (_POINTER, _POINTER),
    "record": (_POINTER, _POINTER, ctypes.c_int64, *[_POINTER] * 5),
}
_loaded: list[Any] = []  # code stays where it is as long as the process lives


@cache
def load(what: str, shape: Shape) -> Callable[..., None]:
    """Return a kernel, "step" or "record", as a function of pointers.

    Raises:
        EstimatorError: it cannot be compiled.
    """
    path = kernel_folder() / f"{_key(what, shape)}.o"
    code = _read(path)
    if code is None:
        with _alone(path):
            code = _read(path)  # another process may have compiled it meanwhile
            if code is None:
                code = _compiled(what, shape)
                _keep(path, code)
    # a step is over before another thread could take its turn; a record is not
    prototype = ctypes.PYFUNCTYPE if what == "step" else ctypes.CFUNCTYPE
    return prototype(None, *_ARGUMENTS[what])(_address(code))


def kernel_folder() -> Path:
    """Return where compiled kernels are kept from one process to the next."""
    return platformdirs.user_cache_path("voltwall", appauthor=False) / "kernels"


def target_machine() -> Any:
    """Return LLVM's description of this processor."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=llvm.get_host_cpu_features().flatten(), opt=3, jit=True
    )


def _address(code: bytes) -> int:
    import llvmlite.binding as llvm

    library = ctypes.CDLL("ucrtbase" if os.name == "nt" else None)
    for name in LIBRARY_CALLS:
        llvm.add_symbol(name, ctypes.cast(library[name], ctypes.c_void_p).value)
    machine = target_machine()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _loaded.append(engine)
    return int(engine.get_function_address(ENTRY))


def _compiled(what: str, shape: Shape) -> bytes:
    command = [
        sys.executable,
        "-m",
        "app.estimation.filters.compiled.build",
        what,
        *(str(int(value)) for value in shape),
    ]
    root = Path(__file__).parents[4]
    try:
        done = subprocess.run(command, capture_output=True, check=False, cwd=root, timeout=COMPILE_S)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise EstimatorError(f"the kernel could not be compiled: {error}") from error
    if done.returncode:
        reason = done.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        raise EstimatorError(f"the kernel could not be compiled: {reason}")
    return done.stdout


@contextlib.contextmanager
def _alone(path: Path) -> Iterator[None]:
    """Keep other processes from compiling the same; where no lock can be had, each compiles."""
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            stack.enter_context(FileLock(f"{path}.lock", timeout=COMPILE_S))
        yield


def _read(path: Path) -> bytes | None:
    """Return the code in a file; None where there is no file or not the one that was written."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    digest, code = content[:32], content[32:]
    return code if hashlib.sha256(code).digest() == digest else None


def _keep(path: Path, code: bytes) -> None:
    """Write a file whole or not at all; a folder that cannot be written costs the time to compile again."""
    part = path.with_suffix(f".{os.getpid()}.part")
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_bytes(hashlib.sha256(code).digest() + code)
        part.replace(path)


@cache
def _environment() -> str:
    import llvmlite.binding as llvm

    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parents[1].rglob("*.py")):
        digest.update(source.read_bytes())
    versions = [importlib.metadata.version(name) for name in ("numba", "llvmlite")]
    about = [digest.hexdigest(), *versions, llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()]
    return "\n".join(about)


def _key(what: str, shape: Shape) -> str:
    about = "\n".join([_environment(), what, *(str(int(value)) for value in shape)])
    return hashlib.sha256(about.encode()).hexdigest()[:32]
