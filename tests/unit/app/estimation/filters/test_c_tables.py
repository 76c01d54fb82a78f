"""The C header of a cell holds the numbers of its tables, and compiles."""

import re
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.c_tables import c_tables
from app.estimation.filters.engine.library import FOLDER, CellModelStruct, SigmaRuleStruct, TuningStruct
from app.estimation.filters.tables import CellTables
from tests.c_programs import require_gcc

CELLS = ["samsung-25r-10p", "panasonic-ncr18650pf", "lco-pouch", "sanyo-ur18650w"]


def numbers(text: str, name: str):
    body = re.search(rf"{name}\[\d+\] = \{{([^}}]*)\}}", text)[1]
    return np.array([float(number.rstrip("f")) for number in body.replace("\n", " ").split(",") if number.strip()])


@pytest.mark.parametrize("name", CELLS)
def test_the_tables_are_those_of_the_cell(name):
    model = load_cell(name)
    text, cell = c_tables(model, 0.02), CellTables(model, 0.02)
    np.testing.assert_allclose(numbers(text, "vw_cell_table"), cell.packed().ravel(), rtol=1e-7)
    np.testing.assert_allclose(numbers(text, "vw_cell_ocv_slope_v"), cell.ocv_slope_v, rtol=1e-7)
    np.testing.assert_allclose(numbers(text, "vw_cell_tau_s"), cell.tau_s.ravel(), rtol=1e-7)
    assert f".n_soc = {cell.soc.size}," in text


def test_every_field_of_the_structs_is_set():
    text = c_tables(load_cell())
    wanted = [name for struct in (CellModelStruct, SigmaRuleStruct, TuningStruct) for name, _ in struct._fields_]
    assert re.findall(r"^    \.(\w+) = ", text, re.MULTILINE) == wanted


@pytest.mark.parametrize("n_rc", [0, 2])
def test_the_header_compiles_and_a_cell_with_too_many_rc_pairs_is_refused(n_rc, tmp_path):
    require_gcc()
    model = load_cell()
    model = replace(model, r_ohm=model.r_ohm[:n_rc], tau_s=model.tau_s[:n_rc], name="a cell */ with a trap")
    (tmp_path / "cell.h").write_text(c_tables(model), encoding="utf-8")
    source = tmp_path / "cell.c"
    source.write_text('#include "cell.h"\nconst vw_cell_model *vw_cell(void) { return &vw_cell_model_of_team; }\n')
    command = ["gcc", "-std=c99", "-Wall", "-Wextra", "-Wno-unused-const-variable", "-DVW_SINGLE", "-I", str(FOLDER)]
    subprocess.run([*command, "-Werror", "-DVW_RC_MAX=3", "-c", str(source), "-o", str(tmp_path / "o")], check=True)
    few = subprocess.run(
        [*command, "-DVW_RC_MAX=2", "-c", str(source), "-o", "/dev/null"], capture_output=True, text=True
    )
    assert (few.returncode != 0) == (n_rc > 1)
    assert ("compile with -DVW_RC_MAX=3" in few.stderr) == (n_rc > 1)
