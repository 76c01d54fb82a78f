from dataclasses import replace

import numpy as np
import pytest

from app.analysis.root_cause.from_session import incidents_of, verdict_of
from app.analysis.root_cause.kept_verdict import keep_verdict
from app.analysis.session_cell import cell_of
from app.estimation.cell_model.cell_file import load_cell
from app.season.lake.facts import Facts, facts_of, where_of
from app.sessions.reading.reader import SessionFile
from app.sessions.recording import session_writer
from tests.recorded.season import CURRENT_A, LAP_S, OCV_V, R_OHM, TIME_S, record

CAPACITY_AH = 26.0


@pytest.fixture(scope="module")
def facts(season) -> Facts:
    with SessionFile(min(season.glob("*.sqlite"))) as session:
        return facts_of(session)


def cell(facts: Facts, lap: int, number: int) -> dict:
    (row,) = [row for row in facts.tables["cells"] if row["lap"] == lap and row["cell"] == number]
    return row


def test_there_is_a_row_for_the_session_and_each_lap_of_every_cell(facts):
    assert len(facts.tables["laps"]) == 3
    assert len(facts.tables["cells"]) == 4 * 96
    assert {(row["pack"], row["cell_in_pack"]) for row in facts.tables["cells"] if row["cell"] == 40} == {(4, 5)}


def test_energy_and_charge_of_a_cell_are_those_of_its_own_voltage(facts):
    volts = OCV_V[40] - CURRENT_A * R_OHM[40]
    hours = 0.5 / 3600
    row = cell(facts, 0, 40)
    assert row["energy_out_wh"] == pytest.approx((volts * CURRENT_A)[1:][CURRENT_A[1:] > 0].sum() * hours, rel=1e-4)
    assert row["energy_in_wh"] == pytest.approx((-volts * CURRENT_A)[1:][CURRENT_A[1:] < 0].sum() * hours, rel=1e-4)
    assert row["charge_out_ah"] == pytest.approx(CURRENT_A[1:][CURRENT_A[1:] > 0].sum() * hours, rel=1e-6)


def test_the_laps_add_up_to_what_lies_within_them(facts):
    inside = (TIME_S >= 1.0) & (TIME_S < 1.0 + 3 * LAP_S)
    whole = CURRENT_A[inside & (CURRENT_A > 0)].sum() * 0.5 / 3600
    laps = sum(cell(facts, lap, 12)["charge_out_ah"] for lap in (1, 2, 3))
    assert laps == pytest.approx(whole, rel=0.02)  # the first sample of a lap stands for no time


def test_a_cells_resistance_is_found_of_session_and_lap(facts):
    for lap in (0, 2):
        assert cell(facts, lap, 7)["resistance_ohm"] == pytest.approx(0.003, rel=0.02)
        assert cell(facts, lap, 8)["resistance_ohm"] == pytest.approx(0.002, rel=0.02)
        assert 0.0 <= cell(facts, lap, 8)["resistance_sigma_ohm"] < 1e-3  # the voltages are exact: rounding decides


def test_extremes_and_means_are_those_of_the_lap(facts):
    second = cell(facts, 2, 40)
    assert second["voltage_min_v"] == pytest.approx(OCV_V[40] - 100 * R_OHM[40], abs=1e-4)
    assert 21.0 <= second["temperature_mean_degc"] <= 21.1
    assert second["temperature_max_degc"] == 22.0
    assert second["soc_used"] == pytest.approx(0.03, abs=5e-4)


def test_what_was_found_stands_in_the_session_and_in_its_lap(facts):
    assert [cell(facts, lap, 7)["findings"] for lap in range(4)] == ["joint", "", "joint", ""]
    assert cell(facts, 0, 8)["findings"] == ""


def test_events_say_in_which_lap_they_were(facts):
    found = {row["code"]: row["lap"] for row in facts.tables["events"]}
    assert (found["note"], found["finding-joint"]) == (1, 2)


def test_time_near_a_limit_is_counted_by_the_limits_of_then(make_session):
    heat = np.where(TIME_S < 60.0, 20.0, 42.0)  # 45 degC are allowed
    path = make_session(TIME_S, CURRENT_A, 3.7, heat)
    with SessionFile(path) as session:
        row = facts_of(session).tables["cells"][0]
    allowed_s = float((TIME_S >= 60.0).sum() * 0.5)
    assert row["near_t_max_s"] == pytest.approx(allowed_s, abs=0.6)
    assert row["near_v_max_s"] == 0.0


def test_a_capacity_is_told_between_two_rests(make_session):
    time_s = np.arange(0.0, 2000.0, 1.0)
    current = np.where((time_s > 300) & (time_s < 1500), 30.0, 0.0)
    used = np.cumsum(current) / 3600 / CAPACITY_AH
    with SessionFile(make_session(time_s[:5], current[:5])) as session:
        ocv = cell_of(session)[0].ocv
    volts = ocv.voltage(0.8 - used)
    with SessionFile(make_session(time_s, current, volts, start_s=1_791_000_000.0)) as session:
        row = facts_of(session).tables["cells"][3]
    assert row["counted_ah"] == pytest.approx(10.0, rel=0.02)
    assert row["capacity_ah"] == pytest.approx(CAPACITY_AH, rel=0.05)
    assert 0.0 < row["capacity_sigma_ah"] < 5.0


def test_facts_are_the_same_however_the_session_was_cut_by_its_commits(make_session, monkeypatch):
    """The same samples, temperatures seldom, in chunks of 7 s and of 100 s: every row and figure is the same."""
    time_s = np.arange(0.0, 240.0, 0.25)
    current = np.where(time_s < 30, 0.0, 60.0 + 50.0 * np.sin(time_s) + time_s / 4)
    soc = 0.8 - np.cumsum(current) * 0.25 / 3600 / CAPACITY_AH
    marks = [(60.0 * k + 5.0, "lap", "") for k in range(4)]
    made = []
    for chunk_s in (7, 100):
        monkeypatch.setattr(session_writer, "CHUNK_NS", chunk_s * 10**9)
        volts = load_cell("samsung-25r-10p").ocv.voltage(soc)[:, None] - current[:, None] * R_OHM
        how = {"markers": marks, "flush_every": 4, "temperature_every": 9}
        path = make_session(time_s, current, volts, 20.0 + time_s / 60, soc, **how)
        with SessionFile(path) as session:
            n_chunks = len(session.chunk_spans_us())
            assert n_chunks > 25 if chunk_s == 7 else n_chunks < 4
            made.append(facts_of(session).tables)
    short, long = ([row for name in ("laps", "cells") for row in tables[name]] for tables in made)
    assert len(short) == len(long) == 3 + 4 * 96
    assert np.isfinite([row["resistance_factor"] for row in short if "resistance_factor" in row]).all()
    for one, other in zip(short, long, strict=True):
        for name in one.keys() - {"session"}:
            is_number = isinstance(one[name], float)
            assert one[name] == (pytest.approx(other[name], 1e-9, nan_ok=True) if is_number else other[name]), name


def test_a_session_of_the_simulator_is_of_another_car(season):
    first, second = sorted(season.glob("*.sqlite"))
    with SessionFile(first) as session:
        assert where_of(session).car == "built-in-master-96-cells"
        assert where_of(session).season == "2026"
    with SessionFile(second) as session:
        where = where_of(session)
    assert (where.car, where.season, where.session) == ("e-26-simulated", "autumn", second.stem)


def test_a_session_without_a_sample_has_facts(make_session):
    with SessionFile(make_session([0.0, 0.1], [0.0, 0.0], np.nan, np.nan)) as session:
        row = facts_of(session).tables["cells"][0]
    assert row["voltage_min_v"] != row["voltage_min_v"]
    assert row["energy_out_wh"] == 0.0


def test_cells_can_be_judged_anew(make_session):
    path = record(make_session, 1_792_000_000.0, 0.9)
    with SessionFile(path) as session:
        told = facts_of(session).tables["cells"]
        judged = facts_of(session, judge_anew=True).tables["cells"]
    assert told[7]["findings"] == "joint"
    assert all(isinstance(row["findings"], str) for row in judged)


def test_a_cell_that_tripped_has_the_condition_of_its_verdict(make_session):
    trip = {"severity": "trip", "code": "trip-cell-undervoltage", "text": "under", "cell": 3, "at_s": 20.0}
    found = {"severity": "warning", "code": "finding-cell-resistance-high", "text": "resists", "cell": 3, "at_s": 15.0}
    path = make_session(TIME_S, CURRENT_A, 3.7, events=[trip, found, found | {"cell": 5}])
    with SessionFile(path) as session:
        (group,) = incidents_of(session)
        verdict = replace(verdict_of(session, group), code="joint-resistance-high", cell=3)
    keep_verdict(path, group, verdict, (), t_wall_ns=0)
    with SessionFile(path) as session:
        facts = facts_of(session)
    assert cell(facts, 0, 3)["findings"] == "joint-resistance-high"
    assert cell(facts, 0, 5)["findings"] == "cell-resistance-high"
