"""Without the C engine's library a command that estimates ends at once, with one line that says what is missing."""

import subprocess
import sys
from pathlib import Path

import pytest

WITHOUT_ENGINE = """
import sys
from pathlib import Path
from app.cli import main
from app.estimation.filters.engine import library
library.LIBRARY = Path("vw_filter.so")
sys.exit(main(sys.argv[1:]))
"""
COMMANDS = [
    "estimate --cell samsung-25r-10p drive.csv",
    "sessions import --data . drive.csv",
    "serve --data . --port 0",
    "season simulate --data . --sessions 1",
    "bench --seconds 1",
]


@pytest.mark.parametrize("words", COMMANDS)
def test_without_its_library_nothing_is_estimated_and_one_line_says_so(tmp_path: Path, words: str) -> None:
    rows = "".join(f"{k},5.0,{3.9 - k * 1e-4:.4f}\n" for k in range(20))
    (tmp_path / "drive.csv").write_text(f"time_s,current_a,voltage_v\n{rows}")
    root = Path(__file__).resolve().parents[4]
    command = [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(root)!r}){WITHOUT_ENGINE}", *words.split()]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=100)
    assert done.returncode == 2, done.stderr
    [line] = done.stderr.splitlines()
    assert "vw_filter.so is missing" in line
    assert "install voltwall again" in line
