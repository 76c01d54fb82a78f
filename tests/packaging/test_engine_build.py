"""What builds the engine where the machine's own compiler does not work, and the line where nothing builds it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import hatch_build

ROOT = Path(__file__).resolve().parents[2]
BLOCKED = "raise ImportError('not installed')\n"


@pytest.fixture
def broken_gcc(tmp_path: Path) -> Path:
    """A folder whose gcc runs and compiles nothing, such as that of a Mac without its command line tools."""
    gcc = tmp_path / "bin" / "gcc"
    gcc.parent.mkdir()
    gcc.write_text("#!/bin/sh\nexit 1\n")
    gcc.chmod(0o755)
    return gcc.parent


def test_a_compiler_that_compiles_nothing_is_none(broken_gcc: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hatch_build.own_compiler.cache_clear()
    monkeypatch.setenv("PATH", str(broken_gcc))
    try:
        assert hatch_build.own_compiler() is None
        pytest.importorskip("ziglang")
        assert hatch_build.compiler(None)[1] == "cc"
    finally:
        hatch_build.own_compiler.cache_clear()


def test_without_any_compiler_one_line_says_what_is_missing(broken_gcc: Path, tmp_path: Path) -> None:
    (tmp_path / "ziglang.py").write_text(BLOCKED)
    for library in hatch_build.LIBRARIES:
        for source in hatch_build.library_sources(ROOT, library):
            copy = tmp_path / "checkout" / source.relative_to(ROOT)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(source.read_bytes())
    (tmp_path / "checkout" / "hatch_build.py").write_bytes((ROOT / "hatch_build.py").read_bytes())
    environment = os.environ | {"PATH": str(broken_gcc), "PYTHONPATH": str(tmp_path)}
    command = [sys.executable, str(tmp_path / "checkout" / "hatch_build.py"), "engine"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    [line] = done.stderr.splitlines()
    assert "no C compiler" in line
    assert "ziglang" in line
