"""Why relays opened, where the recording ends or has a gap right after: nothing is said, and nothing warns."""

from dataclasses import replace

import numpy as np
import pytest

from app.analysis.incidents import Trigger
from app.analysis.root_cause.recording import UNKNOWN, SessionStretch
from app.analysis.root_cause.relays import current_hypotheses, relay_hypotheses
from app.estimation.cell_model.cell_file import load_cell

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
    return SessionStretch(
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


@pytest.mark.parametrize(("real_a", "code"), [(260.0, "overload"), (60.0, "current-sensor-offset")])
@pytest.mark.parametrize("held_s", [0.0, STEP_S, 2 * STEP_S])
def test_a_current_is_real_if_the_cells_sagged_although_it_is_still_shown_when_the_relays_are_open(
    real_a, code, held_s
):
    plain, trip_s = recording(), OPENED_S - 0.3
    tripping = (plain.time_s >= trip_s) & (plain.time_s < OPENED_S + held_s)
    shown_a = np.where(tripping, 260.0 + plain.time_s - OPENED_S, np.where(plain.time_s < OPENED_S, 60.0, 0.0))
    true_a = np.where(tripping & (plain.time_s < OPENED_S), real_a, np.where(plain.time_s < OPENED_S, 60.0, 0.0))
    cells = np.repeat((3.9 - 2e-3 * true_a)[:, None], 4, axis=1)
    trip = Trigger(OPENED_S, OPENED_S, "trip-discharge-overcurrent", "trip", "")
    of = replace(plain, current_a=shown_a, steady_a=shown_a, voltage_v=cells, events=(trip,))
    assert [each.code for each in current_hypotheses(of, load_cell("samsung-25r-10p"))] == [code]
