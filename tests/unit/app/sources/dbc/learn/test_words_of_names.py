"""Names as words and numbers, as DBCs of different teams write them."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.sources.dbc.learn.words_of_names import (
    CELL,
    CURRENT,
    NOT_A_CELL,
    SEGMENT,
    TEMPERATURE,
    VOLTAGE,
    name_set,
    numbers,
    skeleton,
    tokens,
    words,
)

WORD = st.sampled_from(["cell", "volt", "seg", "temp", "bms", "pack", "zelle"])


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("BMS_SegACell03_mV", ("bms", "seg", "a", "cell", "03", "mv")),
        ("cellVoltage12", ("cell", "voltage", "12")),
        ("CELL_VOLTAGE_1", ("cell", "voltage", "1")),
        ("ACCUTemp3", ("accu", "temp", "3")),
        ("Zelle_007_Spannung", ("zelle", "007", "spannung")),
        ("strøm", ("strøm",)),
        ("___", ()),
    ],
)
def test_a_name_is_cut_at_case_underscores_and_digits(name, expected):
    assert tokens(name) == expected


@given(st.lists(WORD, min_size=1, max_size=4), st.integers(0, 999))
def test_the_same_words_are_found_however_they_are_joined(parts, number):
    snake = "_".join(parts) + f"_{number}"
    camel = "".join(part.capitalize() for part in parts) + str(number)
    loud = "_".join(part.upper() for part in parts) + f"{number}"
    assert words(snake) == words(camel) == words(loud) == set(parts)
    assert numbers(snake) == numbers(camel) == numbers(loud) == (number,)


@given(st.lists(st.integers(0, 300), min_size=1, max_size=4))
def test_names_that_differ_in_numbers_only_have_one_skeleton(found):
    name = "_".join(f"C{number:03d}" for number in found)
    assert skeleton(name) == skeleton("_".join("C1" for _ in found))
    assert numbers(name) == tuple(found)


def test_words_of_german_french_and_norwegian_teams_are_known():
    assert words("Zelle_3_Spannung") & VOLTAGE
    assert words("Zelle_3_Spannung") & CELL
    assert words("cellule3_tension") & CELL
    assert words("cellule3_tension") & VOLTAGE
    assert words("pakke_spenning") & VOLTAGE
    assert words("Strom_Batterie") & CURRENT
    assert words("Modul_3_Temperatur") & TEMPERATURE
    assert words("Modul_3_Temperatur") & SEGMENT


@pytest.mark.parametrize(
    "name", ["Min_Cell_Voltage", "MaxCellTemp", "Cell_OverVoltage_Threshold", "Balancing_Cell_3", "Motor_Temp_1"]
)
def test_figures_that_could_be_taken_for_cells_have_a_word_against_them(name):
    assert words(name) & NOT_A_CELL


@pytest.mark.parametrize("name", ["Cell_Voltage_3", "cv12", "VCell_7", "SegA_Cell3", "CellVolt12", "U_Zelle_4"])
def test_no_name_of_a_cell_voltage_has_one(name):
    assert not words(name) & NOT_A_CELL


def test_a_set_of_words_is_its_words():
    assert name_set("a b  c") == {"a", "b", "c"}
