"""Why relays opened, where the recording ends or has a gap right after: nothing is said, and nothing warns."""

import numpy as np
import pytest

from app.analysis.root_cause.recording import UNKNOWN, Recording
from app.analysis.root_cause.relays import relay_hypotheses

BITS = {"load": 0, "fit": 1}
OPENED_S, STEP_S = 40.0, 0.1


def recording(
    until_s=60.0, hides=lambda time_s: np.zeros(time_s.shape, bool), load=lambda t: t < OPENED_S, coasts_s=0.0
):
    """80 A until the relays open, or until some time before; a current that `hides` was not measured."""
    time_s = np.arange(0.0, until_s, STEP_S)
    is_on = load(time_s)
    amps = np.where(hides(time_s), np.nan, np.where(is_on & (time_s < OPENED_S - coasts_s), 80.0, 0.0))
    n, nothing = time_s.size, np.full(time_s.size, np.nan)
    cells = np.full((n, 4), 3.7)
    return Recording(
        time_s=time_s, current_a=amps, steady_a=amps, voltage_v=cells, temperature_degc=cells, soc=nothing,
        flags=is_on.astype(int) | 2, charger_state=np.full(n, UNKNOWN), charger_flags=np.full(n, UNKNOWN),
        fan_duty=nothing, boards=None, line=None, bus=None, events=(), limits={}, start_s=0.0, bits=BITS, segments=(4,),
    )  # fmt: skip


def codes(of):
    return [each.code for each in relay_hypotheses(of)]


@pytest.mark.filterwarnings("error")
def test_relays_that_open_under_load_without_a_trip_are_told():
    assert codes(recording()) == ["external-shutdown"]


def test_a_car_that_has_stopped_switches_high_voltage_off():
    assert codes(recording(coasts_s=1.2)) == []


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("until_s", [OPENED_S + STEP_S / 2, OPENED_S + 0.25])
def test_nothing_is_told_where_the_recording_ends_with_it(until_s):
    assert codes(recording(until_s)) == []


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("gap", [lambda t: t >= OPENED_S, lambda t: t < OPENED_S], ids=["after", "before"])
def test_nothing_is_told_where_the_current_was_not_measured(gap):
    assert codes(recording(hides=gap)) == []


@pytest.mark.filterwarnings("error")
def test_a_link_is_not_judged_by_a_current_that_was_not_measured():
    def again(time_s):
        return (time_s < OPENED_S) | (time_s >= OPENED_S + 10.0)

    def between(time_s):
        return (time_s >= OPENED_S) & (time_s < OPENED_S + 10.0)

    assert "dc-link-discharge-failed" in codes(recording(load=again))
    assert "dc-link-discharge-failed" not in codes(recording(load=again, hides=between))
