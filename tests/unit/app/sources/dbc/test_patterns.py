import re
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.battery.source import LONGEST_PATTERN, MOST_PLACEHOLDERS
from app.sources.dbc.patterns import PatternError, filled, numbers_in, texts_in


@given(st.integers(0, 99), st.integers(0, 999))
def test_the_numbers_of_a_name_are_found_by_part_with_leading_zeros_too(pack, cell):
    name = f"Seg{pack:02}_Cell{cell:03}"
    assert numbers_in("Seg{pack}_Cell{cell}", name, {}) == {"pack": pack, "cell": cell}
    assert numbers_in("Seg{segment}_Cell{cell}", name, {}) == {"pack": pack, "cell": cell}, "as older profiles say"


def test_a_letter_counts_from_the_base():
    assert numbers_in("Seg{pack:a}_{cell}", "SegC_07", {"pack": 1}) == {"pack": 3, "cell": 7}
    assert numbers_in("Seg{pack:a}_{cell}", "Segc_07", {}) == {"pack": 2, "cell": 7}
    assert numbers_in("Seg{pack:a}_{cell}", "Seg3_07", {}) is None


def test_the_name_of_a_flag_is_made_from_the_texts_of_its_value():
    texts = texts_in("CellVoltage_{cell}", "CellVoltage_007")
    assert filled("CellVoltage_{cell}_invalidFlag", texts) == "CellVoltage_007_invalidFlag"
    assert filled("Bad{pack}_{cell}", texts) == "Bad{pack}_007"
    assert texts_in("CellVoltage_{cell}", "Current") == {}


@given(st.text("ABCxyz_.*+([", max_size=8).filter(lambda text: "*" not in text), st.integers(0, 999))
def test_whatever_stands_around_a_number_stands_for_itself(text, cell):
    assert numbers_in(text + "{cell}", f"{text}{cell}", {}) == {"cell": cell}
    assert numbers_in("{cell}" + text, f"{cell}{text}", {}) == {"cell": cell}
    assert numbers_in(text + "{cell}", f"{text}{cell}x", {}) is None


def backtracking(pattern: str, name: str) -> dict[str, str]:
    """What a regular expression finds, which tries each star at its longest first."""
    text, at, seen = "", 0, set()
    for found in re.finditer(r"\{(\w+)(:a)?\}|\*", pattern):
        text += re.escape(pattern[at : found.start()])
        at, part = found.end(), found[1]
        if part in seen:
            text += f"(?P={part})"
        else:
            text += ".*" if part is None else f"(?P<{part}>{'[A-Za-z]' if found[2] else '[0-9]+'})"
        seen |= {part} - {None}
    match = re.fullmatch(text + re.escape(pattern[at:]), name)
    return match.groupdict() if match else {}


@given(
    st.lists(st.sampled_from(["*", "{cell}", "{pack}", "{pack:a}", "V", "_", "1"]), max_size=MOST_PLACEHOLDERS),
    st.text("VA_12", max_size=9),
)
def test_a_name_has_the_parts_that_a_regular_expression_finds(tokens, name):
    pattern = "".join(tokens)
    assert texts_in(pattern, name) == backtracking(pattern, name)


@pytest.mark.parametrize("pattern", ["*a" * (MOST_PLACEHOLDERS - 1) + "*b", "{cell}*{pack}*{cell}x", "*"])
@pytest.mark.parametrize("letter", ["a", "1"])
def test_no_pattern_tries_a_way_twice(pattern, letter):
    began = time.thread_time()
    assert numbers_in(pattern, letter * LONGEST_PATTERN, {}) in (None, {})
    assert time.thread_time() - began < 2.0


@pytest.mark.parametrize("pattern", ["*a" * (MOST_PLACEHOLDERS + 1), "a" * (LONGEST_PATTERN + 1), "*" * 100_000])
def test_a_pattern_beyond_the_limits_is_refused(pattern):
    with pytest.raises(PatternError, match="pattern-too-long"):
        numbers_in(pattern, "a", {})


def test_a_name_beyond_the_limit_fits_no_pattern():
    assert numbers_in("*{cell}", "a" * LONGEST_PATTERN + "1", {}) is None
