"""Programs of the C reference, each compiled once for all tests of a run."""

import hashlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path

import pytest
from filelock import FileLock

C_FOLDER = Path(__file__).parents[1] / "firmware_protocol" / "c"
ENGINE = Path(__file__).parents[1] / "app" / "estimation" / "filters" / "engine"
FLAGS = ("-std=c99", "-O1", "-g1", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wshadow", "-I", str(C_FOLDER))
ON_CHIP = ("-DVW_SINGLE", "-DVW_LANES=1", "-DVW_RC_MAX=3", "-I", str(ENGINE))  # how a microcontroller has the engine
ESTIMATOR = (*sorted(ENGINE.glob("vw_*.c")), C_FOLDER / "estimator" / "vw_estimator.c")
MASTER = sorted((C_FOLDER / "master").glob("vw_*.c"))
LIBRARY = (*sorted(C_FOLDER.glob("vw_*.c")), *MASTER, *ESTIMATOR)
SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
BUILT = Path(__file__).parents[1] / ".pytest_cache" / "c"


def require_gcc() -> None:
    """Skip without gcc; in CI fail."""
    if shutil.which("gcc") is None:
        missing = "gcc is missing; install it (Debian: apt-get install gcc)"
        pytest.fail(missing) if os.environ.get("CI") else pytest.skip(missing)


@cache
def build_program(folder: str) -> Path:
    """Return the program of `firmware_protocol/c/FOLDER`, with sanitizers where gcc has them.

    What is compiled once serves every test process, and later runs as long as no source has changed.
    """
    sources = sorted((C_FOLDER / folder).glob("*.c"))
    return _built(folder, [*LIBRARY, *sources], (FLAGS, ON_CHIP), lambda part: _compile(part, sources))


@cache
def estimator_library() -> Path:
    """Return the estimator of the master as a shared library, in single precision as on the chip."""
    command = ["gcc", *FLAGS, "-Wconversion", "-O2", *ON_CHIP, "-fPIC", "-shared"]

    def compile_into(part: Path) -> None:
        subprocess.run([*command, *map(str, ESTIMATOR), "-o", str(part), "-lm"], check=True)

    return _built("vw_estimator", ESTIMATOR, command, compile_into)


@cache
def slaves_library(*sanitizers: str) -> Path:
    """Return the C master's driver of the slaves and measuring as a library, with what these options of gcc watch."""
    sources = [
        C_FOLDER / "master" / f"vw_{name}.c" for name in ("ltc6804", "slaves", "slaves_values", "balance", "measuring")
    ]
    sources.append(Path(__file__).parent / "c_sizes.c")
    command = ["gcc", *FLAGS, "-Wconversion", *sanitizers, "-fPIC", "-shared"]

    def compile_into(part: Path) -> None:
        subprocess.run([*command, *map(str, sources), "-o", str(part)], check=True)

    return _built("vw_slaves", sources, command, compile_into)


@cache
def build_faulty_disk() -> Path:
    """Return the library that is preloaded into a process to make its disk fail, or to write down what reaches it."""
    source = Path(__file__).parent / "integration" / "faulty_disk.c"
    command = ["gcc", "-shared", "-fPIC", "-O1", "-Wall", "-Werror", str(source), "-ldl"]

    def compile_into(part: Path) -> None:
        subprocess.run([*command, "-o", str(part)], check=True)

    return _built("faulty_disk", [source], command, compile_into)


@cache
def build_fuzzer() -> Path:
    """Return the program that fuzzes the C library by coverage, with sanitizers (`tests/fuzz/loop.c`)."""
    library, folder = sorted(C_FOLDER.glob("vw_*.c")), Path(__file__).parent / "fuzz"
    loop, targets = folder / "loop.c", folder / "targets.c"
    plain = ["gcc", *FLAGS, "-I", str(folder)]
    parts = (
        [*plain, *SANITIZERS, "-fsanitize-coverage=trace-pc", "-c", *map(str, library)],
        [*plain, *SANITIZERS, "-c", str(targets)],
        [*plain, "-O2", "-D_DEFAULT_SOURCE", "-c", str(loop)],
    )

    def compile_into(part: Path) -> None:
        with tempfile.TemporaryDirectory() as made:
            for command in parts:
                subprocess.run(command, cwd=made, check=True)
            subprocess.run(["gcc", *SANITIZERS, *map(str, Path(made).glob("*.o")), "-o", str(part)], check=True)

    return _built("vw_fuzz", [*library, loop, targets, folder / "targets.h"], parts, compile_into)


def _built(name: str, sources: Iterable[Path], how: object, compile_into: Callable[[Path], None]) -> Path:
    """Return what these sources become, compiled only where no process of this or an earlier run has done so."""
    require_gcc()
    seen = hashlib.sha256(repr(how).encode())
    for path in (*sources, *sorted(C_FOLDER.rglob("*.h")), *sorted(ENGINE.glob("*.h"))):
        seen.update(path.read_bytes())
    built = BUILT / f"{name}-{seen.hexdigest()[:24]}"
    BUILT.mkdir(parents=True, exist_ok=True)
    with FileLock(f"{built}.lock"):
        if not built.exists():
            part = built.with_suffix(".part")
            compile_into(part)
            part.replace(built)
    return built


def _compile(program: Path, sources: list[Path]) -> None:
    built = _link(program, sources, SANITIZERS)
    if built.returncode and "cannot find" in built.stderr:  # a gcc without its sanitizers
        built = _link(program, sources, ())
    assert built.returncode == 0, built.stderr


def _link(program: Path, sources: list[Path], flags: tuple[str, ...]) -> subprocess.CompletedProcess[str]:
    command = ["gcc", *FLAGS, *ON_CHIP, *flags, *map(str, [*sources, _library(flags)]), "-o", str(program), "-lm"]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@cache
def _library(flags: tuple[str, ...]) -> Path:
    """Return the C library as one object, which every program is linked with."""

    def compile_into(part: Path) -> None:
        with tempfile.TemporaryDirectory() as made:
            subprocess.run(["gcc", *FLAGS, *ON_CHIP, *flags, "-c", *map(str, LIBRARY)], cwd=made, check=True)
            subprocess.run(["gcc", "-r", "-o", str(part), *map(str, Path(made).glob("*.o"))], check=True)

    return _built("library", LIBRARY, (FLAGS, ON_CHIP, flags), compile_into)
