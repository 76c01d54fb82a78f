import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.sources.dbc.patterns import PatternError, compiled, filled, numbers_in, texts_in


@given(st.integers(0, 99), st.integers(0, 999))
def test_the_numbers_of_a_name_are_found_by_part_with_leading_zeros_too(segment, cell):
    name = f"Seg{segment:02}_Cell{cell:03}"
    assert numbers_in("Seg{segment}_Cell{cell}", name, {}) == {"segment": segment, "cell": cell}


def test_a_letter_counts_from_the_base():
    assert numbers_in("Seg{segment:a}_{cell}", "SegC_07", {"segment": 1}) == {"segment": 3, "cell": 7}
    assert numbers_in("Seg{segment:a}_{cell}", "Segc_07", {}) == {"segment": 2, "cell": 7}
    assert numbers_in("Seg{segment:a}_{cell}", "Seg3_07", {}) is None


def test_a_star_stands_for_anything_and_the_rest_for_itself():
    assert numbers_in("*_V{cell}", "BMS1_front_V12", {}) == {"cell": 12}
    assert numbers_in("V.{cell}", "Vx12", {}) is None
    assert numbers_in("V{cell}", "V12_min", {}) is None


def test_a_part_that_stands_twice_has_to_be_the_same_twice():
    assert numbers_in("C{cell}_V{cell}", "C3_V3", {}) == {"cell": 3}
    assert numbers_in("C{cell}_V{cell}", "C3_V4", {}) is None


def test_a_placeholder_that_is_no_part_of_a_cells_number_is_named():
    with pytest.raises(PatternError, match="cel"):
        compiled("V{cel}")


def test_the_name_of_a_flag_is_made_from_the_texts_of_its_value():
    texts = texts_in("CellVoltage_{cell}", "CellVoltage_007")
    assert filled("CellVoltage_{cell}_invalidFlag", texts) == "CellVoltage_007_invalidFlag"
    assert filled("Bad{segment}_{cell}", texts) == "Bad{segment}_007"
    assert texts_in("CellVoltage_{cell}", "Current") == {}


@given(st.text("ABCxyz_.*+([", max_size=8).filter(lambda text: "*" not in text), st.integers(0, 999))
def test_whatever_stands_around_a_number_stands_for_itself(text, cell):
    assert numbers_in(text + "{cell}", f"{text}{cell}", {}) == {"cell": cell}
    assert numbers_in("{cell}" + text, f"{cell}{text}", {}) == {"cell": cell}
    assert numbers_in(text + "{cell}", f"{text}{cell}x", {}) is None
