from dataclasses import replace
from typing import get_args

import pytest

from app.estimation.health.cell_finding import CellFinding, FindingCode
from app.telemetry import TripCause
from app.telemetry.cell_findings import agreeing, finding_of, findings_in_words, sensors_of
from app.words import condition, render
from app.words.render import languages

NAN = float("nan")


def told(code, size, unit, value=1.0, sigma=0.001):
    return finding_of(
        CellFinding(code, 63, size, sigma, unit, 1e9, 1e9 + 60, 30.0, 50.0, value, 0.002, (60, 61, 62, 64), 0.98)
    )


@pytest.mark.parametrize("language", languages())
@pytest.mark.parametrize("code", get_args(FindingCode))
@pytest.mark.parametrize("value", [1.0, NAN])
def test_every_finding_is_told_whole_in_every_language(code, value, language):
    finding = told(code, 0.05, "", value)
    for message in (finding.message, finding.evidence):
        text = render(message, [12] * 8, language)
        assert "{" not in text
        assert message.code not in text
    assert render(finding.message, [12] * 8, language).lower().startswith(("pack 6, cell 4", "pakke 6, celle 4"))


def test_sizes_are_told_in_the_units_of_the_workshop():
    assert "14.00 mΩ (12.00 to 16.00 mΩ)" in render(told("joint-resistance-high", 14e-3, "ohm").message)
    assert "21 mA (19 to 23 mA)" in render(told("self-discharge-high", 0.021, "A").message)
    assert "6.1 A" in render(told("self-discharge-high", 6.1, "A").message)
    assert "30 %" in render(told("capacity-low", 0.3, "1").message)


def test_what_has_no_size_has_none():
    finding = told("temperature-sensor-fault", NAN, "K", NAN)
    assert (finding.size, finding.low, finding.high, finding.value) == (None, None, None, None)
    assert finding.seen - finding.since == 60.0


def sensor_off(cell):
    return CellFinding("temperature-sensor-fault", cell, NAN, NAN, "K", 1e9, 1e9 + 60, 30.0, NAN, NAN, 30.0, (), 0.9)


@pytest.mark.parametrize(
    ("language", "name"),
    [
        ("en", "temperature sensor 2, pack 2, cell 1 to pack 2, cell 12: "),
        ("nb", "temperatursensor 2, pakke 2, celle 1 til pakke 2, celle 12: "),
    ],
)
def test_a_sensor_that_stands_for_many_cells_is_named_once(language, name):
    sensors = tuple(tuple(range(start, start + 12)) for start in range(0, 96, 12))
    found = findings_in_words([sensor_off(cell) for cell in range(12, 24)], sensors)
    assert [finding.cell for finding in found] == [12]
    assert render(found[0].message, [12] * 8, language).startswith(name)


def test_a_cell_without_a_sensor_has_no_finding_of_one_and_a_joint_stays_its_cells():
    joint = CellFinding("joint-resistance-high", 3, 0.01, 0.001, "ohm", 1e9, 1e9 + 60, 30.0, 50.0, 1.0, 0.002, (), 0.98)
    assert [finding.code for finding in findings_in_words([joint, sensor_off(5)], ((0, 1),))] == [
        "joint-resistance-high"
    ]


def test_where_each_cell_has_its_own_sensor_the_cell_is_named():
    sensors = sensors_of(tuple((cell,) for cell in range(96)), 96)
    (found,) = findings_in_words([sensor_off(13)], sensors)
    assert render(found.message, [12] * 8).startswith("pack 2, cell 2: ")


def verdict(code="joint-resistance-high", cell=63, size=13.6e-3):
    name = condition(code)
    return TripCause(
        code, name, cell, 5, 0.84, (), size=size, low=12e-3, high=15.2e-3, unit="ohm", since=1e9, judged=1e9 + 5
    )


def test_a_finding_of_the_tripped_cell_has_the_size_of_the_verdict_and_its_confidence():
    other = finding_of(CellFinding("capacity-low", 3, 0.2, 0.01, "1", 1e9, 1e9, 30.0, 50.0, 1.0, 1.0, (), 0.9))
    found = agreeing([told("joint-resistance-high", 14e-3, "ohm"), other], [verdict()])
    assert [(each.code, each.cell, each.size, each.low, each.high, each.confidence) for each in found] == [
        ("joint-resistance-high", 63, 13.6e-3, 12e-3, 15.2e-3, 0.84),
        ("capacity-low", 3, 0.2, other.low, other.high, 0.9),
    ]
    assert "13.60 mΩ (12.00 to 15.20 mΩ)" in render(found[0].message)
    evidence = render(found[0].evidence)  # the watch had compared values that are another size
    assert "confidence 84 %" in evidence
    assert "mΩ" not in evidence


@pytest.mark.parametrize("order", [1, -1])
def test_of_two_verdicts_on_a_cell_the_newest_counts(order):
    verdicts = [replace(verdict("capacity-low", size=None), judged=1e9), verdict()]
    assert [each.code for each in agreeing([], verdicts[::order])] == ["joint-resistance-high"]


def test_a_finding_that_a_verdict_contradicts_is_replaced_by_the_verdict():
    (found,) = agreeing([told("capacity-low", 0.2, "1")], [verdict()])
    assert (found.code, found.size, found.since, found.seen) == ("joint-resistance-high", 13.6e-3, 1e9, 1e9 + 5)
    assert "13.60 mΩ" in render(found.message)


@pytest.mark.parametrize(("code", "cell"), [("unknown", 63), ("overload", None), ("slave-lost", None)])
def test_a_verdict_on_no_cell_adds_no_finding_and_takes_none(code, cell):
    known = told("joint-resistance-high", 14e-3, "ohm")
    assert agreeing([known], [TripCause(code, condition("overload"), cell, None, 0.5)]) == (known,)


def test_a_verdict_without_a_size_leaves_the_size_of_the_finding():
    (found,) = agreeing([told("cell-voltage-stuck", 0.05, "V")], [verdict("cell-voltage-stuck", size=None)])
    assert (found.code, found.size, found.low, found.confidence) == ("cell-voltage-stuck", 0.05, 0.048, 0.84)
