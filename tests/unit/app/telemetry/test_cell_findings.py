import pytest

from app.estimation.health.cell_finding import CODES, CellFinding
from app.telemetry.cell_findings import finding_of
from app.words import render
from app.words.render import languages

NAN = float("nan")


def told(code, size, unit, value=1.0, sigma=0.001):
    return finding_of(
        CellFinding(code, 63, size, sigma, unit, 1e9, 1e9 + 60, 30.0, 50.0, value, 0.002, (60, 61, 62, 64), 0.98)
    )


@pytest.mark.parametrize("language", languages())
@pytest.mark.parametrize("code", CODES)
@pytest.mark.parametrize("value", [1.0, NAN])
def test_every_finding_is_told_whole_in_every_language(code, value, language):
    finding = told(code, 0.05, "", value)
    for message in (finding.message, finding.evidence):
        text = render(message, language)
        assert "{" not in text
        assert message.code not in text
    assert render(finding.message, language).lower().startswith(("pack 6, cell 4", "pakke 6, celle 4"))


def test_sizes_are_told_in_the_units_of_the_workshop():
    assert "14.00 mΩ (12.00 to 16.00 mΩ)" in render(told("joint-grown", 14e-3, "ohm").message)
    assert "21 mA (19 to 23 mA)" in render(told("cell-leaks", 0.021, "A").message)
    assert "6.1 A" in render(told("cell-leaks", 6.1, "A").message)
    assert "30 %" in render(told("capacity-lost", 0.3, "1").message)


def test_what_has_no_size_has_none():
    finding = told("thermistor-off", NAN, "K", NAN)
    assert (finding.size, finding.low, finding.high, finding.value) == (None, None, None, None)
    assert finding.seen - finding.since == 60.0
