"""A recorded sum over missing cells is no sum: in series, exports, laps, report and season."""

import csv

import numpy as np
import pytest

from app.analysis.laps.figures import Lap, figures_of
from app.analysis.report.summary import headline, key_figures
from app.analysis.session_survey import read_pieces, read_totals, survey_session
from app.season.lake.cell_sums import CellSums
from app.season.lake.facts import _of_session
from app.sessions.export.export import export
from app.sessions.reading.reader import SessionFile

N, LOST = 600, slice(200, 400)  # samples of 0.1 s
START_S = 1_790_000_000


@pytest.fixture(params=[range(36, 48), [40]], ids=["slave lost", "wire broken"])
def session(make_session, request):
    volts = np.full((N, 96), 3.7)
    volts[LOST, list(request.param)] = np.nan
    with SessionFile(make_session(np.arange(N) / 10, np.full(N, 100.0), volts, 25.0, start_s=START_S)) as made:
        yield made


def test_the_sum_and_the_mean_are_missing_where_a_cell_is(session):
    series = session.series(["v_tot", "v_avg", "v_min"], points=N)
    for name, usual in (("v_tot", 355.2), ("v_avg", 3.7)):
        values = series[name].minimum
        assert np.isnan(values[LOST]).all(), name
        assert np.delete(values, np.arange(N)[LOST]) == pytest.approx(usual), name
    assert session.series(["v_tot"], points=N)["v_tot"].minimum[300] != pytest.approx(310.8)


def test_an_export_has_no_sum_where_a_cell_is_missing(session, tmp_path):
    path = tmp_path / "out.csv"
    export(session, path, "csv", signals=["v_tot", "v_avg"])
    with path.open(newline="") as file:
        names, *rows = csv.reader(file)
    at = names.index("v_tot (V)")
    assert {row[at] for row in rows[LOST]} == {""}
    assert {float(row[at]) for row in rows[: LOST.start]} == {355.2}


def test_a_lap_has_the_energy_and_mean_power_of_all_cells_or_none(session):
    totals = read_totals(session)
    assert np.isnan(totals.voltage_v[LOST]).all()
    figures = figures_of(Lap(START_S, START_S + 60), totals)
    assert (figures.energy_out_wh, figures.power_mean_w, figures.power_max_w) == (None, None, pytest.approx(35_520))
    healthy = figures_of(Lap(START_S, START_S + 15), totals)
    assert healthy.energy_out_wh == pytest.approx(35_520 * 15 / 3600, rel=0.01)
    short = figures_of(Lap(START_S + 15, START_S + 25), totals)  # lost for its last 5 s
    assert short.power_mean_w == pytest.approx(35_520)


def test_report_and_comparison_give_no_energy_of_the_measured_cells_alone(session):
    survey = survey_session(session)
    figures = key_figures(survey)
    assert (figures["energy_out_wh"], figures["energy_in_wh"]) == (None, None)
    assert figures["power_max_w"] == pytest.approx(35_520)
    codes = [each.code for each in headline(survey, 0).args["figures"]]
    assert codes[0] == "report-energy-out-at-least"


def test_in_the_season_the_session_and_the_missing_cells_have_no_energy(session):
    sums, survey = CellSums(96), survey_session(session)
    for piece in read_pieces(session):
        sums.add(piece, {})
    energy_wh = sums.columns()["energy_out_wh"]
    assert np.isnan(energy_wh[40])
    assert energy_wh[0] == pytest.approx(3.7 * 100 * 60 / 3600, rel=0.01)
    assert _of_session(survey)["energy_out_wh"] is None
