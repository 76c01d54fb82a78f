"""The notebook of the documentation runs from its first cell to its last."""

import json
import shutil
from pathlib import Path

import pytest

NOTEBOOK = Path(__file__).parents[3] / "docs" / "examples" / "season.ipynb"
CELLS = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]


def test_every_code_cell_runs_in_order(season, tmp_path, monkeypatch, capsys):
    pytest.importorskip("pandas", reason="pandas is not installed")
    plt = pytest.importorskip("matplotlib.pyplot", reason="matplotlib is not installed")
    monkeypatch.setattr(plt, "show", lambda: plt.close("all"))
    shutil.copytree(season, tmp_path / "sessions")
    monkeypatch.setenv("VOLTWALL_DATA", str(tmp_path))
    names: dict[str, object] = {}
    for number, cell in enumerate(CELLS):
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), f"cell {number}", "exec"), names)
    assert "lap 2: 60.0 s" in capsys.readouterr().out
    assert len(names["resistance"]) == 24


def test_it_is_kept_without_outputs():
    assert [cell["outputs"] for cell in CELLS if cell["cell_type"] == "code" and cell["outputs"]] == []
