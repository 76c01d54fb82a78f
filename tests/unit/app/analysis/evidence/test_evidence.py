import numpy as np
import pytest

from app.analysis.evidence.evidence import NoEvidence, cell_of_test, coverage, evidence_of, judge, limit_rows
from app.analysis.evidence.master_samples import SampledValues
from app.analysis.evidence.steps import STEPS
from app.analysis.evidence.timing import Timing, Unmeasured
from app.estimation.cell_model.cell_file import format_cell, load_cell
from app.estimation.errors import EstimatorError
from app.sessions.reading.reader import SessionFile
from firmware_protocol.config_image import default_image, with_value
from firmware_protocol.messages import EventCode

CELL = load_cell("samsung-25r-10p")
BY_NAME = {step.name: step for step in STEPS}


def timing(low_s, high_s, trip=EventCode.TRIP_V_MAX):
    return Timing(low_s, high_s, 0.04, 0.03, 0.02, 0.002, 0.4, 30, 5.0, 4.2, trip)


@pytest.mark.parametrize(
    ("low_s", "high_s", "verdict"),
    [(0.3, 0.5, "passed"), (0.45, 0.51, "not-shown"), (0.501, 0.6, "failed")],
)
def test_a_step_is_passed_only_where_the_whole_band_is_in_time(low_s, high_s, verdict):
    assert judge(BY_NAME["voltage-high"], timing(low_s, high_s)).verdict == verdict


def test_where_the_rules_name_no_time_it_has_to_open():
    assert judge(BY_NAME["wire-lost"], timing(1.0, 3.0)).verdict == "opened"
    assert judge(BY_NAME["wire-lost"], Unmeasured("not-opened")).verdict == "failed"


def test_another_trip_than_the_fault_is_told():
    assert judge(BY_NAME["voltage-high"], timing(0.3, 0.4)).trip_fits is True
    assert judge(BY_NAME["voltage-high"], timing(0.3, 0.4, EventCode.TRIP_T_MAX)).trip_fits is False
    assert judge(BY_NAME["voltage-high"], timing(0.3, 0.4, None)).trip_fits is None


@pytest.mark.parametrize("why", ["no-frames", "violated-before", "restarted"])
def test_what_says_nothing_of_the_master_fails_nothing(why):
    assert judge(BY_NAME["voltage-high"], Unmeasured(why)).verdict == "not-tested"


@pytest.mark.parametrize(
    ("field", "value", "standing"),
    [
        ("v_cell_max", 4.2, "within"),
        ("v_cell_max", 4.21, "beyond"),
        ("v_cell_min", 2.49, "beyond"),
        ("t_cell_max", 60, "within"),
        ("t_cell_max", 61, "beyond"),  # limit of the rules, though the data sheet allows 75
        ("t_cell_min", -21, "beyond"),
        ("i_disc_max", 201, "pulses"),
    ],
)
def test_limits_stand_against_the_data_sheet_and_the_rules(field, value, standing):
    rows = {row.name: row for row in limit_rows(with_value(default_image(), field, value), CELL)}
    assert rows[field].in_force == pytest.approx(value)
    assert rows[field].standing == standing


def values(missing_v=(), missing_t=()):
    voltage, temperature = np.full(96, 39_000, np.uint16), np.full(96, 25, np.int8)
    voltage[list(missing_v)], temperature[list(missing_t)] = 0, -128
    return SampledValues(is_ok=True, is_loaded=True, current=(0, 0), voltage=voltage, temperature=temperature)


@pytest.mark.parametrize(
    ("seen", "least", "is_enough"),
    [
        (values(), 1.0, True),
        (values(missing_v=[5]), 1.0, False),
        (values(missing_t=range(12, 20)), 4 / 12, True),
        (values(missing_t=range(12, 21)), 3 / 12, False),  # share of this pack, though 91 % of all cells have one
    ],
)
def test_coverage_counts_the_pack_with_the_fewest(seen, least, is_enough):
    found = coverage(seen)
    assert found.least_share == pytest.approx(least)
    assert found.is_enough is is_enough


def test_another_session_is_no_evidence(make_session):
    with SessionFile(make_session([], [])) as session, pytest.raises(NoEvidence, match="voltwall evidence"):
        evidence_of(session)


def test_a_session_names_no_cell_file_of_this_machine(tmp_path):
    (tmp_path / "cell.toml").write_text(format_cell(CELL))
    assert cell_of_test("samsung-25r-10p", "s").name == cell_of_test(format_cell(CELL), "s").name == CELL.name
    with pytest.raises(EstimatorError):
        cell_of_test(str(tmp_path / "cell.toml"), "s")
