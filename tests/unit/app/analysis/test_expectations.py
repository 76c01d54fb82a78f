from types import SimpleNamespace

import numpy as np
import pytest

from app.analysis.expectations import Expectations, Raised, SnapshotValues
from app.errors import ConfigError
from app.sources.loaded_battery import team_battery


def values(t_s, soc=0.5, volts=3.7, recorded=0.5):
    totals, cells = SimpleNamespace(soc=soc, current_a=None), SimpleNamespace(voltage_v=np.full(96, volts))
    return SnapshotValues(t_s, totals, cells, recorded)


def held(text, alarms=(), samples=()):
    expected = Expectations(text, team_battery().battery)
    for alarm in alarms:
        expected.alarm(alarm)
    for sample in samples:
        expected.values(sample)
    return [verdict.held for verdict in expected.verdicts()]


LOOSE = Raised(70.0, "joint-resistance-high", "warning", 30)
TRIP = Raised(181.0, "cell-undervoltage", "trip", 30)


@pytest.mark.parametrize(
    ("expectation", "expected"),
    [
        ('[[alarm]]\ncode = "joint-resistance-high"', True),
        ('[[alarm]]\ncode = "joint-loose"', True),  # a code of an earlier version
        ('[[alarm]]\ncode = "joint-resistance-high"\ncell = "3/7"\nfrom_s = 60\nto_s = 80', True),
        ('[[alarm]]\ncode = "joint-resistance-high"\ncell = "3/8"', False),
        ('[[alarm]]\ncode = "joint-resistance-high"\nto_s = 60', False),
        ('[[alarm]]\nseverity = "trip"\ncount = 2', True),
        ('[[alarm]]\nseverity = "trip"\ncount = 1', False),
        ('[[no_alarm]]\nseverity = "trip"', False),
        ('[[no_alarm]]\nseverity = "trip"\nto_s = 180', True),
        ('[[no_alarm]]\ncode = "cell-overtemperature"', True),
    ],
)
def test_alarms_are_told_apart_by_code_severity_cell_time_and_count(expectation, expected):
    assert held(expectation, [LOOSE, TRIP, TRIP]) == [expected]


@pytest.mark.parametrize(
    ("expectation", "expected"),
    [
        ('name = "soc"\nmin = 0.3', True),
        ('name = "soc"\nmin = 0.41', False),
        ('name = "soc"\nmax = 0.5\nfrom_s = 5', True),
        ('name = "soc"\nat_s = 5\nmin = 0.449\nmax = 0.451', True),
        ('name = "soc"\nat_s = 1000\nmin = 0', False),
        ('name = "current_a"\nmin = 0', False),
        ('name = "voltage_v[3/7]"\nmin = 3.7\nmax = 3.7', True),
    ],
)
def test_values_are_judged_over_a_time_or_at_one(expectation, expected):
    assert held("[[value]]\n" + expectation, samples=[values(t, 0.5 - 0.01 * t) for t in range(11)]) == [expected]


@pytest.mark.parametrize(("bound", "expected"), [("rms_max = 0.009", False), ("rms_max = 0.011", True)])
def test_agreement_is_with_what_was_recorded(bound, expected):
    assert held(f"[[agreement]]\n{bound}", samples=[values(t, recorded=0.51) for t in range(5)]) == [expected]
    assert held(f"[[agreement]]\n{bound}", samples=[values(t, recorded=None) for t in range(5)]) == [False]
    assert held("[[agreement]]\nlargest_max = 0.02", samples=[values(0, recorded=0.53)]) == [False]


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("[[alarm", "TOML"),
        ("", "at least one"),
        ("[[alarm]]\ncell = '1/1'", r"alarm\[1\]"),
        ("[[alarm]]\ncode = 'x'\ncolour = 1", r"alarm\[1\].colour"),
        ("[[alarm]]\ncode = 'x'\n[[alarm]]\ncode = 'x'\ncell = '9/1'", r"alarm\[2\].cell"),
        ("[[alarm]]\nseverity = 'bad'", "severity"),
        ("[[alarm]]\ncode = 'x'\nfrom_s = 5\nto_s = 4", "to_s"),
        ("[[alarm]]\ncode = 'x'\ncount = -1", "count"),
        ("[alarm]\ncode = 'x'", r"\[\[alarm\]\]"),
        ("[[value]]\nname = 'speed'\nmin = 1", r"value\[1\].name"),
        ("[[value]]\nname = 'soc[1/13]'\nmin = 1", r"value\[1\].cell"),
        ("[[value]]\nname = 'soc'", "min or max"),
        ("[[value]]\nname = 'soc'\nmin = 'much'", "a number"),
        ("[[agreement]]", "rms_max"),
        ("[[other]]", "other"),
        ("replay = 3\n[[alarm]]\ncode = 'x'", "a table"),
    ],
)
def test_what_cannot_be_expected_is_named(text, named):
    with pytest.raises(ConfigError, match=named):
        Expectations(text, team_battery().battery)
