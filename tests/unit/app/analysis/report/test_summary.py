import numpy as np
import pytest

from app.analysis.report.report import with_cell as named_event
from app.analysis.report.summary import compare_cells, headline, margins, odd_cells, recommended_checks, what_limited
from app.analysis.survey import Survey
from app.words import Cell, Message, sentence

LIMITS = {"v_cell_min": 2.5, "v_cell_max": 4.2, "t_cell_max": 45.0, "i_disc_max": 200.0, "i_disc_min": -100.0}


def survey(**changes):
    rng = np.random.default_rng(2)
    made = Survey(
        96,
        start_s=0.0,
        end_s=1200.0,
        samples=12000,
        driving_s=900.0,
        energy_out_wh=5000.0,
        energy_in_wh=400.0,
        current_max_a=150.0,
        current_min_a=-30.0,
        power_max_w=5e4,
        voltage_min_v=3.2 + rng.normal(0, 0.01, 96),
        voltage_min_at_s=np.full(96, 100.0),
        voltage_max_v=np.full(96, 4.1),
        temperature_max_degc=np.full(96, 36.0),
        temperature_max_at_s=np.full(96, 100.0),
        soc_first=np.full(96, 0.9),
        soc_last=0.4 + rng.normal(0, 0.001, 96),
        lowest_s=np.full(96, 9.0),
        sag_v=rng.normal(0, 0.003, 96),
        missing=np.zeros(96),
        resistance_ohm=0.0018 + rng.normal(0, 3e-5, 96),
    )
    for name, value in changes.items():
        setattr(made, name, value)
    return made


def texts(found):
    return [sentence(each, [12] * 8).text for each in found]


def with_cell(name, cell, value):
    made = survey()
    getattr(made, name)[cell] = value
    return made


def test_a_calm_run_limits_nothing_and_nothing_stands_out():
    calm = survey()
    near = margins(calm, LIMITS)
    assert texts(what_limited(near, []))[0].startswith("All values stayed within their limits. The closest was")
    assert texts(recommended_checks(calm, odd_cells(calm), [], 0)) == ["No anomalies found."]
    assert sentence(headline(calm, 12)).text == (
        "20 min, 15 min under load, 12 laps: 5.00 kWh discharged, "
        "0.40 kWh charged or recovered (8 %), SOC from 90 to 40 %, "
        "hottest cell 36 \u00b0C."
    )


@pytest.mark.parametrize(
    ("name", "value", "limit"),
    [("voltage_min_v", 2.6, "v_min"), ("temperature_max_degc", 44.0, "t_max"), ("voltage_max_v", 4.195, "v_max")],
)
def test_the_limit_that_came_nearest_is_named_with_its_cell(name, value, limit):
    near = margins(with_cell(name, 30, value), LIMITS)
    assert (near[0].limit, near[0].cell) == (limit, 30)
    assert "pack 3, cell 7" in texts(what_limited(near, []))[0]


def test_trips_come_first_and_limits_that_were_not_heard_are_said_so():
    assert texts(what_limited(margins(survey(), LIMITS), ["cell too hot"]))[0] == "Tripped: cell too hot."
    assert [each.code for each in what_limited(margins(survey(), {}), [])] == ["report-no-limits"]


@pytest.mark.parametrize(
    ("name", "value", "what"),
    [
        ("sag_v", 0.03, "sag"),
        ("temperature_max_degc", 41.0, "temperature"),
        ("lowest_s", 600.0, "lowest"),
    ],
)
def test_the_odd_cell_is_found_and_no_other(name, value, what):
    found = odd_cells(with_cell(name, 30, value))
    assert [(odd.cell, odd.what) for odd in found] == [(30, what)]
    assert texts(recommended_checks(survey(), found, [], 0))[0].startswith("Pack 3, cell 7 ")


def test_an_unbalanced_end_lost_time_and_damage_are_told():
    made = with_cell("soc_last", 30, 0.30)
    made.soc_first[30] = 0.80
    made.gap_s = 12.0
    said = " ".join(texts(recommended_checks(made, [], ["busbar joint has grown"], 3)))
    for told in (
        "pack 3, cell 7 lowest. Balance the cells.",
        "Busbar joint has grown.",
        "12 s",
        "3 frames arrived damaged",
    ):
        assert told in said


def test_cells_that_came_apart_on_the_way_are_not_told_to_be_balanced():
    (said,) = texts(recommended_checks(with_cell("soc_last", 30, 0.2), [], [], 0))
    assert "SOC spread increased from 0.0 %" in said
    assert "Balance" not in said


def test_of_two_sessions_the_cell_that_changed_comes_first():
    second = survey()
    second.resistance_ohm = 1.3 * second.resistance_ohm  # colder: all of them
    second.resistance_ohm[30] *= 1.2
    changed = compare_cells(survey(), second)
    assert (changed[0].cell, changed[0].change) == (30, pytest.approx(0.2, abs=0.01))
    assert max(abs(each.change) for each in changed[1:]) < 0.01
    assert compare_cells(survey(resistance_ohm=np.full(96, np.nan)), second) == []


def test_of_many_cells_of_a_kind_every_one_is_named():
    made = survey()
    made.sag_v[[5, 6, 7, 8, 9]] = 0.05
    found = recommended_checks(made, odd_cells(made), [], 0)
    assert [each.code for each in found] == ["report-odd"] * 3 + ["report-odd-more"]
    said = " ".join(texts(found)).lower()
    assert all(f"pack 1, cell {cell}" in said for cell in (6, 7, 8, 9, 10))


def test_an_event_is_reported_with_its_place_once():
    assert named_event("slave lost", None, [12] * 8) == "slave lost"
    assert named_event("pack 3, cell 7 too hot", 30, [12] * 8) == "pack 3, cell 7 too hot"
    event = named_event("too hot", 30, [12] * 8)
    assert event == Message("reported-at-cell", event="too hot", cell=Cell(30))
    assert texts([Message("report-tripped", event=event)]) == ["Tripped: too hot (pack 3, cell 7)."]
