"""Limits that signals carry judge a recorded session as they judged it live."""

from pathlib import Path

import numpy as np
import pytest

from app.analysis.limits import MovingLimit, known_limits, limits_over_time
from app.analysis.report.report import report_of
from app.live.pipeline_factory import PipelineFactory
from app.sessions.reading.reader import SessionFile
from app.sessions.transfer.import_session import import_file
from app.sources.loaded_battery import load_battery
from app.sources.recordings.import_mapping import ImportMapping
from app.telemetry import ProtectionLimits
from tests.peer_batteries import one_signal_a_cell
from tests.recorded.peer_sessions import write_log, write_profile

CARRIED = """[battery.limits]
cell_voltage_min_v = 2.8
temperature_max_degc = {signal = "Max_Cell_Temp"}
charge_current_max_a = {signal = "Pack_SOC"}
"""


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session of eight cells whose BMS tells two limits: 39 - 40 degC at most, 32 A of charging."""
    folder, peer = tmp_path_factory.mktemp("limits"), one_signal_a_cell(8, 8, "V{}", "T{}", 0.0001, "V")
    battery = load_battery(str(write_profile(peer, folder, more=CARRIED)))

    def pipeline(of):
        return PipelineFactory("coulomb", None, of).pipeline("replay", "imported", "imported")

    log = write_log(peer, folder / "run.log", 8.0)
    return import_file(log, ImportMapping(), folder / "sessions", pipeline, battery=battery).info.path


def test_what_signals_carry_is_in_force_beside_what_the_profile_states(path: Path) -> None:
    with SessionFile(path) as session:
        told = limits_over_time(session).at()
        names = [f"limit.{name}" for name in ("temperature_max_degc", "charge_current_max_a")]
        hottest, charging = session.samples([session.signals.find(name) for name in names])
    assert told == {
        "v_cell_min": 2.8,
        "t_cell_max": hottest.counts[-1],
        "i_disc_min": -charging.counts[-1],
    }


def test_the_report_judges_by_them(path: Path) -> None:
    with SessionFile(path) as session:
        report = report_of(session)
    by_limit = {margin.limit: margin for margin in report.margins}
    assert {"v_min", "t_max", "i_min"} <= by_limit.keys()
    assert by_limit["t_max"].allowed == report.limits["t_cell_max"]
    assert by_limit["i_min"].allowed == report.limits["i_disc_min"]


def test_a_limit_is_not_known_before_it_was_told() -> None:
    limit = MovingLimit(np.array([5.0, 8.0]), np.array([60.0, 50.0]))
    np.testing.assert_array_equal(limit.at(np.array([4.0, 5.0, 7.9, 8.0])), [np.nan, 60.0, 60.0, 50.0])


def test_what_a_snapshot_was_judged_by_leaves_out_what_nobody_told() -> None:
    nan = float("nan")
    limits = ProtectionLimits(2.5, nan, nan, 60.0, nan, -30.0, nan, nan)
    assert known_limits(limits) == {"v_cell_min": 2.5, "t_cell_max": 60.0, "i_disc_min": -30.0}
    assert known_limits(None) == {}
