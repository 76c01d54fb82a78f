"""A made-up recording whose every figure is known."""

from dataclasses import replace

import numpy as np
import pytest

from app.analysis.survey import Survey, Surveyor, SurveyPiece

N = 96
STEP_S = 0.1
RESISTANCE_OHM = 0.002 + 0.0001 * (np.arange(N) % 5)


def piece(start_s, seconds, current_a, *, open_v=3.7, degc=30.0, soc=0.5, bled=None):
    time_s = start_s + np.arange(0.0, seconds - STEP_S / 2, STEP_S)
    current = np.broadcast_to(np.asarray(current_a(time_s) if callable(current_a) else current_a, float), time_s.shape)
    volts = open_v - current[:, None] * RESISTANCE_OHM
    bits = np.zeros((len(time_s), N))
    if bled is not None:
        bits[:, bled] = 1.0
    return SurveyPiece(time_s, current, volts, np.full((len(time_s), N), degc), np.full((len(time_s), N), soc), bits)


def survey_of(pieces, n_cells) -> Survey:
    surveyor = Surveyor(n_cells)
    for each in pieces:
        surveyor.add(each)
    return surveyor.result()


def wave(time_s):
    return np.where(np.sin(time_s) + np.sin(0.31 * time_s) > 0, 120.0, -20.0)


def test_energy_charge_and_time_are_those_that_flowed():
    survey = survey_of([piece(0, 100, 0.0), piece(100, 3600, 100.0), piece(3700, 100, -10.0)], N)
    assert survey.charge_out_ah == pytest.approx(100, rel=1e-3)
    assert survey.charge_in_ah == pytest.approx(10 * 100 / 3600, rel=1e-3)
    assert survey.driving_s == pytest.approx(3700, abs=1)
    volts = (3.7 - 100 * RESISTANCE_OHM).sum()
    assert survey.energy_out_wh == pytest.approx(100 * volts, rel=1e-3)
    assert survey.power_max_w == pytest.approx(100 * volts)
    assert (survey.samples, survey.gap_s) == (38000, 0)


def test_a_gap_is_counted_and_nothing_flows_in_it():
    survey = survey_of([piece(0, 60, 100.0), piece(600, 60, 100.0)], N)
    assert survey.gap_s == pytest.approx(540, abs=0.2)
    assert survey.charge_out_ah == pytest.approx(100 * 120 / 3600, rel=0.01)


def test_resistances_come_out_of_a_drive():
    survey = survey_of([piece(60 * k, 60, wave) for k in range(5)], N)
    np.testing.assert_allclose(survey.resistance_ohm, RESISTANCE_OHM, rtol=0.02)
    assert (survey.sag_v[4] - survey.sag_v[0]) == pytest.approx(0.0004 * 120, rel=0.02)


def test_histograms_hold_every_second():
    survey = survey_of([piece(0, 100, 5.0, degc=30), piece(100, 50, 500.0, degc=-30)], N)
    current = survey.histograms["current"]
    assert (current.edges, current.seconds) == ([0.0, 10.0], [pytest.approx(100, abs=0.2)])
    assert current.above_s == pytest.approx(50, abs=0.2)
    heat = survey.histograms["temperature"]
    assert (sum(heat.seconds), heat.below_s) == (pytest.approx(100 * N, rel=0.01), pytest.approx(50 * N, rel=0.01))


def test_extremes_know_cell_and_time():
    made = piece(0, 60, 10.0)
    made.voltage_v[300, 17] = 2.7
    made.voltage_v[:, 3] = np.nan
    made.temperature_degc[100, 5] = 55.0
    survey = survey_of([made], N)
    assert (survey.voltage_min_v[17], survey.voltage_min_at_s[17]) == (2.7, pytest.approx(30.0))
    assert (survey.temperature_max_degc[5], survey.temperature_max_at_s[5]) == (55, pytest.approx(10.0))
    assert survey.missing[3] == 600
    assert np.isnan(survey.voltage_min_v[3])


def test_rests_and_balancing_are_found():
    pieces = [piece(0, 30, 0.2, open_v=4.0), piece(30, 60, 50.0), piece(90, 150, 0.0, open_v=3.6, bled=[7, 8])]
    survey = survey_of(pieces, N)
    assert survey.first_rest.voltage_v == pytest.approx(np.full(N, 4.0), abs=1e-3)
    assert survey.last_rest.voltage_v == pytest.approx(np.full(N, 3.6))
    assert survey.last_rest.time_s == pytest.approx(239.9)
    assert survey.balancing_s[[6, 7, 8]] == pytest.approx([0, 150, 150], abs=0.2)
    assert survey_of([piece(0, 30, 50.0), piece(30, 60, 0.0)], N).last_rest is None  # too short to have settled


def test_a_recording_of_nothing_has_no_figures():
    survey = survey_of([], N)
    assert survey.samples == 0
    assert np.isnan(survey.resistance_ohm).all()


def in_turns(seconds, round_s):
    """Cells one after the other, each held until it is told again; the current moves meanwhile."""
    whole = piece(0, seconds, wave)
    slot = (np.arange(N) * round_s / N / STEP_S).astype(int)
    step = np.arange(len(whole.time_s))[:, None]
    period = int(round_s / STEP_S)
    told_at = step - (step - slot) % period
    volts = np.take_along_axis(whole.voltage_v, np.maximum(told_at, 0), axis=0)
    is_new = (told_at == step) & (told_at >= 0)
    return replace(whole, voltage_v=np.where(told_at >= 0, volts, np.nan), is_new=is_new)


def test_resistances_of_cells_that_are_told_in_turns_come_from_what_was_told_with_the_current():
    told = in_turns(600, 1.0)
    assert survey_of([told], N).resistance_ohm == pytest.approx(RESISTANCE_OHM, rel=0.05)
    assert (survey_of([replace(told, is_new=None)], N).resistance_ohm < 0.8 * RESISTANCE_OHM).mean() > 0.5


def test_a_cell_is_not_missing_before_its_first_turn_but_one_that_never_came_is():
    told = in_turns(60, 5.0)
    told.voltage_v[:, 7] = np.nan
    for cuts in ([told], [replace(told, **{k: v[:20] for k, v in vars(told).items()}),
                          replace(told, **{k: v[20:] for k, v in vars(told).items()})]):  # fmt: skip
        surveyor = Surveyor(N, in_turns=True)
        for each in cuts:
            surveyor.add(each)
        missing = surveyor.result().missing
        assert missing[7] == len(told.time_s)
        assert (np.delete(missing, 7) == 0).all()
