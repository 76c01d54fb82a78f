"""A command that estimates without the C engine says so, in one line."""

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


@pytest.mark.parametrize("words", [["estimate", "--cell", "samsung-25r-10p"], ["sessions", "import", "--data", "."]])
def test_estimating_without_the_engine_is_said_in_one_line(tmp_path: Path, words: list[str]) -> None:
    rows = "".join(f"{k},5.0,{3.9 - k * 1e-4:.4f}\n" for k in range(20))
    (tmp_path / "drive.csv").write_text(f"time_s,current_a,voltage_v\n{rows}")
    root = Path(__file__).resolve().parents[5]
    command = [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(root)!r}){WITHOUT_ENGINE}", *words]
    done = subprocess.run([*command, "drive.csv"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    said = [line for line in done.stderr.splitlines() if "slow reference" in line]
    assert said == ["estimating with the slow reference: vw_filter.so has not been built for this machine"]
