import pytest

from app.cli import main
from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.c_tables import c_tables


def test_a_cell_is_written_as_a_header(tmp_path, capsys):
    out = tmp_path / "cell.h"
    assert main(["firmware", "--cell", "lco-pouch", "--soc-step", "0.02", "--out", str(out)]) == 0
    assert out.read_text() == c_tables(load_cell("lco-pouch"), 0.02)
    assert main(["firmware"]) == 0
    assert capsys.readouterr().out == c_tables(load_cell("samsung-25r-10p"))


@pytest.mark.parametrize("arguments", [["--cell", "no-such-cell"], ["--out", "/no/such/folder/cell.h"]])
def test_a_cell_or_a_place_that_does_not_exist_is_named(arguments, capsys):
    assert main(["firmware", *arguments]) == 2
    assert arguments[1] in capsys.readouterr().err
