import json

import numpy as np
import pytest

from app.analysis.laps.figures import Lap
from app.analysis.laps.from_session import CanCounter, lap_table, lap_times, overlay_laps, settle_laps
from app.analysis.report.report import report_of
from app.cli import main
from app.errors import ConfigError
from app.season.lake.facts import facts_of
from app.sessions.errors import NotASession, UnknownSignal
from app.sessions.reading.reader import SessionFile
from app.sessions.reading.session_info import write_note
from firmware_protocol.memory_map import FIELDS

START_S = 1_790_000_000.0
LAP_S = 60.0
TIME_S = np.arange(0.0, 5 * LAP_S + 0.1, 0.5)
WAVE = np.sign(np.sin(2 * np.pi * TIME_S / LAP_S * 7) + np.sin(2 * np.pi * TIME_S / LAP_S * 3 + 1))
CURRENT_A = np.where(WAVE > 0, 100.0, -20.0)


@pytest.fixture
def path(make_session):
    volts = np.full((len(TIME_S), 96), 3.7)
    volts[:, 40] = 3.6
    volts[(TIME_S > 130) & (TIME_S < 140), 7] = 3.3
    heat = np.tile(20 + np.floor(TIME_S / LAP_S)[:, None], (1, 96))
    soc = 0.9 - 0.03 * TIME_S / LAP_S
    markers = [(-5.0, "driver", "Anna"), (2.5 * LAP_S, "driver-change", "driver change: Bo")]
    markers += [(k * LAP_S + 1, "lap", "") for k in range(5)]
    can = [(t, 0x310, bytes([7, int(t // LAP_S)])) for t in TIME_S]
    return make_session(TIME_S, CURRENT_A, volts, heat, soc, markers=markers, can=can)


def test_a_lap_says_what_it_cost(path):
    with SessionFile(path) as session:
        table = lap_table(session)
    assert table.source == "markers"
    assert [(each.lap.start_s - START_S, each.lap.duration_s) for each in table.laps] == [
        pytest.approx((k * LAP_S + 1, LAP_S), abs=1e-3) for k in range(4)
    ]
    lap = table.laps[2]
    inside = (TIME_S >= 121) & (TIME_S < 181)
    volts = 95 * 3.7 + 3.6
    out_wh = volts * 100 * 0.5 * (CURRENT_A[inside] > 0).sum() / 3600
    assert lap.energy_out_wh == pytest.approx(out_wh, rel=0.02)
    assert lap.energy_in_wh == pytest.approx(volts * 20 * 0.5 * (CURRENT_A[inside] < 0).sum() / 3600, rel=0.04)
    assert lap.power_max_w == pytest.approx(100 * volts, rel=1e-3)
    assert lap.power_min_w == pytest.approx(-20 * volts, rel=1e-3)
    assert lap.soc_used == pytest.approx(0.03, abs=3e-4)
    assert lap.temperature_rise_k == 1
    assert (lap.weakest_cell, lap.voltage_min_v) == (7, pytest.approx(3.3))
    assert (table.laps[0].weakest_cell, table.laps[0].voltage_min_v) == (40, pytest.approx(3.6))


def test_every_mark_of_the_crew_is_where_laps_meet_also_over_a_stop(make_session):
    time_s = np.arange(0.0, 200.0, 0.5)
    current_a = np.where((time_s > 80) & (time_s < 120), 0.0, 100.0)  # stands for 40 s
    marks_s = [10.0, 70.0, 150.0]
    path = make_session(time_s, current_a, markers=[(at_s, "lap", "") for at_s in marks_s])
    with SessionFile(path) as session:
        assert [each.lap.duration_s for each in lap_table(session).laps] == pytest.approx([60], abs=1e-3)
        assert lap_times(session) == pytest.approx([START_S + at_s for at_s in marks_s], abs=1e-3)


def test_a_single_mark_is_where_laps_meet_if_the_power_tells_nothing(make_session):
    time_s = np.arange(0.0, 20.0, 0.5)
    with SessionFile(make_session(time_s, np.zeros(len(time_s)), markers=[(7.0, "lap", "")])) as session:
        assert lap_times(session) == pytest.approx([START_S + 7.0], abs=1e-3)


def test_drivers_are_compared_by_the_laps_that_they_drove(path):
    with SessionFile(path) as session:
        table = lap_table(session)
    assert [each.lap.driver for each in table.laps] == ["Anna", "Anna", "Bo", "Bo"]  # Bo had most of the third
    assert {one.driver: one.laps for one in table.drivers} == {"Anna": 2, "Bo": 2}
    assert table.drivers[0].energy_out_wh == pytest.approx(
        np.mean([f.energy_out_wh for f in table.laps if f.lap.driver == table.drivers[0].driver])
    )


def test_a_counter_on_can_marks_laps(path):
    with SessionFile(path) as session:
        table = lap_table(session, "can", CanCounter(0x310, 1))
        assert [each.lap.start_s - START_S for each in table.laps] == pytest.approx([60, 120, 180, 240])
        assert lap_table(session, "can", CanCounter(0x310, 0)).laps == []
        assert lap_table(session, "can", CanCounter(0x310, 2)).laps == []
        with pytest.raises(ConfigError, match="can_id"):
            lap_table(session, "can")


def test_a_signal_of_the_session_that_goes_up_marks_laps(make_session):
    flags = np.floor(TIME_S / LAP_S).astype(int)[:, None]
    windows = ((FIELDS["charger.flags"].offset, 1), (420, 20), (1884, 204), (2280, 116))
    path = make_session(TIME_S, CURRENT_A, fields={"charger.flags": flags}, windows=windows)
    with SessionFile(path) as session:
        table = lap_table(session, "signal", "charger.flags")
        assert (table.source, [lap.lap.start_s - START_S for lap in table.laps]) == (
            "signal",
            pytest.approx([60, 120, 180, 240], abs=0.01),
        )
        assert lap_table(session, "signal", "n_slaves").laps == []
        with pytest.raises(ConfigError, match="lap_signal"):
            lap_table(session, "signal")
        with pytest.raises(UnknownSignal, match="speed"):
            lap_table(session, "signal", "speed")


def test_a_signal_of_a_dbc_marks_laps(path, tmp_path, capsys):
    dbc = tmp_path / "dash.dbc"
    dbc.write_text(
        'VERSION ""\nBS_:\nBU_: Dash\nBO_ 784 Dash: 2 Dash\n SG_ Lap : 8|8@1+ (1,0) [0|255] "" Vector__XXX\n'
        ' SG_ Seven : 0|8@1+ (1,0) [0|255] "" Vector__XXX\n'
    )
    command = ["sessions", "laps", str(path), "--dbc", str(dbc), "--json", "--laps-from"]
    for name in ("dbc:Lap", "dbc:Dash.Lap"):
        assert main([*command, name]) == 0
        starts = [each["lap"]["start_s"] - START_S for each in json.loads(capsys.readouterr().out)["laps"]]
        assert starts == pytest.approx([60, 120, 180, 240])
    assert main([*command, "dbc:Speed"]) == 2
    assert "Speed" in capsys.readouterr().err


def test_the_pattern_finds_them_without_any_mark(path):
    with SessionFile(path) as session:
        table = lap_table(session, "pattern")
    assert [each.lap.duration_s for each in table.laps] == pytest.approx([LAP_S] * 5, abs=1.0)
    assert [each.lap.is_partial for each in table.laps] == [False] * 4 + [True]  # the recording ends while it drives


def test_a_lap_that_the_end_of_the_recording_cuts_off_counts_nowhere(make_session, capsys):
    kept = TIME_S < 4.9 * LAP_S
    with SessionFile(make_session(TIME_S[kept], CURRENT_A[kept], markers=[(-5.0, "driver", "Anna")])) as session:
        table = lap_table(session)
        assert [(each.lap.is_partial, each.lap.counts) for each in table.laps] == [(False, True)] * 4 + [(True, False)]
        assert (table.drivers[0].laps, table.drivers[0].best_lap_s) == (4, pytest.approx(LAP_S, abs=1.0))
        assert len(lap_times(session)) == 5  # at the cut no laps meet
        assert facts_of(session).tables["sessions"][0]["n_laps"] == 4
        assert [row["counts"] for row in facts_of(session).tables["laps"]] == [True] * 4 + [False]
        assert "4 laps" in report_of(session).findings.headline.text
        path = session.path
    assert main(["sessions", "laps", str(path)]) == 0
    assert capsys.readouterr().out.count("(partial) (not counted)") == 1


def test_settled_laps_win_until_they_are_taken_back(path):
    mine = [Lap(START_S + 100, START_S + 200, "Cleo", "rain"), Lap(START_S + 10, START_S + 90, "Cleo", counts=False)]
    settle_laps(path, mine, t_wall_ns=1, who="anna")
    with SessionFile(path) as session:
        table = lap_table(session)
        assert table.source == "settled"
        assert [each.lap for each in table.laps] == mine[::-1]
        assert [one.laps for one in table.drivers] == [1]
    settle_laps(path, None, t_wall_ns=2, who="anna")
    with SessionFile(path) as session:
        assert lap_table(session).source == "markers"


@pytest.mark.parametrize(
    ("laps", "named"),
    [
        ([Lap(5, 5)], r"laps\[1\].end"),
        ([Lap(5, 9), Lap(8, 12)], r"laps\[2\].start"),
        ([Lap(5, 9, "x" * 201)], r"laps\[1\]"),
        ([Lap(i, i + 1) for i in range(2001)], "laps"),
    ],
)
def test_laps_that_cannot_be_are_refused_by_name(path, laps, named):
    with pytest.raises(ConfigError, match=named):
        settle_laps(path, laps, t_wall_ns=1, who=None)
    with SessionFile(path) as session:
        assert session.note("laps") is None


@pytest.mark.parametrize(
    "value", [7, [7], [{"start_s": 1.0}], [{"start_s": "a", "end_s": 2.0}], [{"start_s": 2.0, "end_s": 1.0}]]
)
def test_settled_laps_that_another_program_damaged_are_an_error_that_says_so(path, value):
    write_note(path, "laps", value, t_wall_ns=1, who="a script")
    with SessionFile(path) as session, pytest.raises(NotASession, match="saved laps damaged"):
        lap_table(session)


def test_laps_lie_on_each_other_place_by_place(path):
    with SessionFile(path) as session:
        laps = [each.lap for each in lap_table(session).laps]
        over = overlay_laps(session, laps, [0, 2], "v_min_v", 60)
        assert over.unit == "V"
        first, third = over.laps
        assert first.minimum == pytest.approx([3.6] * 60)
        assert [k for k, low in enumerate(third.minimum) if low < 3.5] == list(range(9, 19))
        of_cell = overlay_laps(session, laps, [2], "v[7]", 60)
        assert (of_cell.unit, min(of_cell.laps[0].minimum)) == ("V", pytest.approx(3.3))
        with pytest.raises(ConfigError, match="lap"):
            overlay_laps(session, laps, [4], "v[7]", 60)


def test_laps_with_few_samples_are_laid_over_each_other_without_gaps(path):
    with SessionFile(path) as session:
        laps = [each.lap for each in lap_table(session).laps]
        over = overlay_laps(session, laps, [0, 2], "v_min_v", 2000)
        assert 10 < over.points < 2000
        assert all(len(trace.minimum) == over.points and None not in trace.minimum for trace in over.laps)


def test_a_session_without_telemetry_has_no_laps(make_session):
    with SessionFile(make_session([], [])) as session:
        table = lap_table(session)
    assert (table.source, table.laps, table.drivers) == ("pattern", [], [])
