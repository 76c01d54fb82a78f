"""Values of a cell file by type and shape; what is wrong is named by field and line."""

import tomllib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.estimation.cell_model.cell_document import SECTIONS, CellDocument
from app.estimation.errors import CellFileError

TEXT = """
name = "A"
capacity_ah = 2.5  # nominal

[ocv]
soc = [0, 0.5, 1]
voltage_v = [3.0, 3.6, 4.2]

[circuit]
soc = [0.0, 1.0]
temperature_degc = [0, 25]
r0_ohm = [[2e-3, 1e-3], [1e-3, 5e-4]]

[[circuit.rc]]
r_ohm = 1e-3
tau_s = 10

[[circuit.rc]]
r_ohm = [1e-3, 2e-3]
tau_s = 100
"""


def document(text=TEXT):
    return CellDocument(tomllib.loads(text), text, "a.toml")


def refused(call, *words):
    with pytest.raises(CellFileError) as error:
        call(*words)
    return error.value


def line_with(text):
    return next(number for number, line in enumerate(TEXT.splitlines(), 1) if line.startswith(text))


def test_numbers_rows_and_tables_come_out_as_written():
    made = document()
    assert made.number("", "capacity_ah") == 2.5
    assert made.row("ocv", "voltage_v").tolist() == [3.0, 3.6, 4.2]
    assert made.table("circuit", "r0_ohm", (2, 2)).tolist() == [[2e-3, 1e-3], [1e-3, 5e-4]]
    assert list(made.listed("circuit", "rc", ("r_ohm", "tau_s"))) == [0, 1]


@pytest.mark.parametrize(("pair", "expected"), [(0, [[1e-3, 1e-3]] * 2), (1, [[1e-3, 2e-3]] * 2)])
def test_one_number_or_one_row_stands_for_every_temperature(pair, expected):
    assert document().table(f"circuit.rc[{pair}]", "r_ohm", (2, 2)).tolist() == expected


def test_what_may_be_left_out_has_its_default_or_is_unknown():
    made = document()
    assert made.number("", "coulombic_efficiency", 0.99) == 0.99
    assert made.number_or_none("limits", "charge_max_a") is None
    assert not made.has("asinh", "voltage_v")
    assert made.word("ocv", "method") == "interpolation"


def test_what_must_be_there_is_named():
    error = refused(document().number, "", "v_max_v")
    assert (error.field, error.line) == ("v_max_v", None)
    assert "missing" in str(error)


@pytest.mark.parametrize(("field", "start"), [("capacity_ah", "capacity_ah"), ("ocv.voltage_v", "voltage_v")])
def test_a_field_is_found_on_its_line(field, start):
    assert document().line_of(field) == line_with(start)


def test_each_pair_has_lines_of_its_own():
    first, second = (document().line_of(f"circuit.rc[{k}].tau_s") for k in range(2))
    lines = TEXT.splitlines()
    assert (lines[first - 1], lines[second - 1]) == ("tau_s = 10", "tau_s = 100")


def test_a_missing_field_is_shown_at_its_section():
    assert document().line_of("circuit.ocv_shift_v") == line_with("[circuit]")


@pytest.mark.parametrize("wrong", ['"2.5"', "true", "[2.5]"])
def test_a_number_of_another_type_is_refused_on_its_line(wrong):
    error = refused(document(TEXT.replace("2.5  #", f"{wrong}  #")).number, "", "capacity_ah")
    assert (error.field, error.line) == ("capacity_ah", line_with("capacity_ah"))


@pytest.mark.parametrize("wrong", ["[[3.0], [3.6, 4.2]]", '["a", "b"]', "[true, false]", "[]", "[[3.0, 3.6]]"])
def test_a_row_that_is_none_is_refused(wrong):
    text = TEXT.replace("[3.0, 3.6, 4.2]", wrong)
    assert refused(document(text).row, "ocv", "voltage_v").field == "ocv.voltage_v"


def test_a_table_that_does_not_fit_the_grids_names_both_shapes():
    error = refused(document().table, "circuit", "r0_ohm", (2, 3))
    assert "(2, 2)" in str(error)
    assert "(2, 3)" in str(error)


@pytest.mark.parametrize(
    ("added", "field"),
    [("colour = 3\n", "colour"), ("[paint]\ncolour = 3\n", "paint"), ("ocv = 3\n", "ocv")],
)
def test_what_no_cell_file_has_is_refused(added, field):
    text = added + ("" if added.startswith("ocv") else 'name = "A"\n')
    assert refused(document(text).refuse_unknown).field == field


@given(st.sampled_from(sorted(SECTIONS)), st.from_regex(r"[a-z_]{1,12}", fullmatch=True))
def test_a_field_of_another_section_is_refused(section, key):
    text = f"[{section}]\n{key} = 1\n"
    if key in SECTIONS[section]:
        document(text).refuse_unknown()
    else:
        error = refused(document(text).refuse_unknown)
        assert (error.field, error.line) == (f"{section}.{key}", 2)


def test_a_field_alone_is_refused_where_it_needs_another():
    made = document("[asinh]\nvoltage_v = 0.1\n")
    assert refused(made.refuse_alone, "asinh", "voltage_v", "current_a").field == "asinh.current_a"
    made.refuse_alone("hysteresis", "rate", "voltage_v")


@pytest.mark.parametrize(("text", "field"), [("[circuit]\nrc = 3\n", "rc"), ("[[circuit.rc]]\nc_f = 3\n", "c_f")])
def test_pairs_that_are_none_are_refused(text, field):
    assert refused(document(text).listed, "circuit", "rc", ("r_ohm", "tau_s")).field.endswith(field)


def test_more_pairs_than_there_can_be_are_refused():
    text = "[[circuit.rc]]\nr_ohm = 1e-3\ntau_s = 1\n" * 9
    assert "one of 9" in str(refused(document(text).listed, "circuit", "rc", ("r_ohm", "tau_s")))


def test_a_number_beyond_every_float_is_refused():
    text = f"capacity_ah = 1{'0' * 400}\n"
    assert "too large" in str(refused(document(text).number, "", "capacity_ah"))


def test_tables_are_copies():
    made = document()
    made.table("circuit", "r0_ohm", (2, 2))[:] = np.nan
    assert np.isfinite(made.table("circuit", "r0_ohm", (2, 2))).all()
