from pathlib import Path

import can
import cantools
import numpy as np
import pytest

from app.errors import ImportFailed, LimitExceeded
from app.sources.recordings import can_log
from app.sources.recordings.bad_rows import BadRows
from app.sources.recordings.can_log import column_profile, one_signal, read_frames, read_signals
from app.sources.recordings.profile import ImportProfile
from app.words import render
from firmware_protocol.memory_map import CAN_ID_EXTENDED

START_S = 1_780_000_000.0
DBC = """
VERSION ""
BU_: BMS
BO_ 256 Pack: 8 BMS
 SG_ PackCurrent : 0|16@1- (0.1,0) [0|0] "A" BMS
 SG_ Level : 16|8@1+ (0.5,0) [0|0] "%" BMS
BO_ 257 Cells: 8 BMS
 SG_ CellID : 0|8@1+ (1,0) [0|0] "" BMS
 SG_ CellVoltage : 8|16@1+ (0.0001,0) [0|0] "V" BMS
BO_ 2566869221 Temps: 8 BMS
 SG_ Temp1 : 0|8@1+ (1,-40) [0|0] "C" BMS
 SG_ Level : 8|8@1+ (1,0) [0|0] "" BMS
"""
PROFILE = ImportProfile(current="PackCurrent", voltages="CellVoltage[CellID]", temperatures="Temp{n}", hold_s=1.0)


@pytest.fixture
def dbc(tmp_path: Path) -> Path:
    path = tmp_path / "bus.dbc"
    path.write_text(DBC)
    return path


@pytest.fixture
def log(tmp_path: Path, dbc: Path) -> Path:
    """Two seconds: the current every 0.5 s, each of two cells once, the temperature at the start."""
    database = cantools.database.load_file(dbc)
    frames = [
        (0.0, "Temps", {"Temp1": 31, "Level": 7}),
        (0.0, "Pack", {"PackCurrent": 12.3, "Level": 55.0}),
        (0.2, "Cells", {"CellID": 0, "CellVoltage": 3.6}),
        (0.4, "Cells", {"CellID": 1, "CellVoltage": 3.7}),
        *((0.5 * k, "Pack", {"PackCurrent": -1.0 * k, "Level": 55.0}) for k in range(1, 5)),
    ]
    path = tmp_path / "bus.log"
    with can.Logger(path) as logger:
        for at_s, name, values in frames:
            message = database.get_message_by_name(name)
            logger.on_message_received(
                can.Message(
                    timestamp=START_S + at_s, arbitration_id=message.frame_id, data=message.encode(values),
                    is_extended_id=message.is_extended_frame, channel="can0",
                )
            )  # fmt: skip
    return path


def test_frames_come_with_time_and_id(log: Path) -> None:
    frames = list(read_frames(log))
    assert len(frames) == 8
    assert frames[0][:2] == (START_S, 0x18FF50E5 | CAN_ID_EXTENDED)
    assert frames[1][1] == 256


def test_remote_and_error_frames_carry_nothing(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    with can.Logger(path) as logger:
        logger.on_message_received(can.Message(timestamp=1.0, arbitration_id=1, is_remote_frame=True, channel="can0"))
        logger.on_message_received(can.Message(timestamp=1.0, arbitration_id=2, data=b"x", channel="can0"))
    assert [frame[1] for frame in read_frames(path)] == [2 | CAN_ID_EXTENDED]


def test_a_row_is_a_frame_with_the_current_and_others_are_held(log: Path, dbc: Path) -> None:
    table = read_signals(log, dbc).table(PROFILE)
    assert table.columns["time"] == pytest.approx(START_S + np.arange(5) / 2)
    assert table.columns["PackCurrent"] == pytest.approx([12.3, -1, -2, -3, -4])
    first, second = table.columns["CellVoltage[0]"], table.columns["CellVoltage[1]"]
    assert first == pytest.approx([np.nan, 3.6, 3.6, np.nan, np.nan], nan_ok=True)  # older than 1 s: missing
    assert second == pytest.approx([np.nan, 3.7, 3.7, np.nan, np.nan], nan_ok=True)
    assert table.columns["Temp1"] == pytest.approx([31, 31, 31, np.nan, np.nan], nan_ok=True)


def test_the_profile_of_such_a_table_has_a_time_and_patterns() -> None:
    assert column_profile(PROFILE) == {"time": "time", "time_unit": "s", "voltages": "CellVoltage[{n}]"}


def test_a_name_of_two_messages_needs_its_message(log: Path, dbc: Path) -> None:
    names = sorted(read_signals(log, dbc).found)
    assert {"Pack.Level", "Temps.Level", "PackCurrent", "Pack.PackCurrent", "CellVoltage[1]"} <= set(names)
    assert "Level" not in names


def test_one_signal_is_read_out_of_frames(log: Path, dbc: Path) -> None:
    times_s, values = one_signal(read_frames(log), "bus.log", dbc, "Pack.PackCurrent")
    assert times_s == pytest.approx(START_S + np.arange(5) / 2)
    assert values == pytest.approx([12.3, -1, -2, -3, -4])
    with pytest.raises(ImportFailed, match=r"none of its frames with a signal Speed is in bus\.dbc"):
        one_signal(read_frames(log), "bus.log", dbc, "Speed")


def test_a_current_that_is_in_no_frame_is_named(log: Path, dbc: Path) -> None:
    with pytest.raises(ImportFailed, match="current = 'Amps'"):
        read_signals(log, dbc).table(ImportProfile(current="Amps", voltages="CellVoltage[CellID]"))


def test_what_is_no_dbc_or_no_log_is_named(tmp_path: Path, log: Path) -> None:
    (tmp_path / "other.dbc").write_text("hello")
    with pytest.raises(ImportFailed, match=r"other\.dbc: not a readable DBC"):
        sorted(read_signals(log, tmp_path / "other.dbc").found)
    (tmp_path / "bad.log").write_text("hello there you\n")
    with pytest.raises(ImportFailed, match=r"bad\.log: 1 of 1 frames cannot be read"):
        list(read_frames(tmp_path / "bad.log"))


def test_frames_that_a_log_tells_late_count_at_their_own_time(tmp_path: Path, dbc: Path) -> None:
    frames = [
        "(3.0) can1 101#0098A8",  # cell 0, the newer one first
        "(1.0) can0 100#0A00",
        "(2.0) can1 101#00A08C",
        "(3.5) can0 100#1E00",
        "(2.5) can0 100#1400",
    ]
    (tmp_path / "late.log").write_text("\n".join(frames) + "\n")
    table = read_signals(tmp_path / "late.log", dbc).table(PROFILE)
    np.testing.assert_array_equal(table.columns["time"], [1.0, 2.5, 3.5])
    np.testing.assert_allclose(table.columns["PackCurrent"], [1.0, 2.0, 3.0])
    np.testing.assert_allclose(table.columns["CellVoltage[0]"], [np.nan, 3.6, 4.3160])


def test_the_columns_of_a_log_are_those_of_its_frames_not_of_the_dbc(tmp_path: Path, dbc: Path) -> None:
    (tmp_path / "part.log").write_text("(1.0) can0 100#0A00\n(1.1) can0 7FF#00\n")
    assert sorted(read_signals(tmp_path / "part.log", dbc).found) == ["Pack.PackCurrent", "PackCurrent"]


def test_a_bad_line_or_frame_does_not_end_a_log(tmp_path: Path, dbc: Path) -> None:
    lines = [f"({k}.0) can0 100#0A00" for k in range(40)]
    lines[7] = "(7.0) can0 1x0#0A00"
    lines[9] = "(nan) can0 100#0A00"
    (tmp_path / "bad.log").write_text("\n".join(lines) + "\n(40.0) can0 10")  # and the end cut off
    bad = BadRows()
    assert len(list(read_frames(tmp_path / "bad.log", bad))) == 38
    assert [line for line, _ in bad.first] == [8, 10]
    profile = ImportProfile(current="PackCurrent", voltages="Level")
    table = read_signals(tmp_path / "bad.log", dbc).table(profile)
    assert len(table.columns["time"]) == 38
    assert any("2 of 40 frames cannot be read" in note and "line 8" in note for note in map(render, table.notes))


@pytest.mark.parametrize("ending", ["asc", "trc"])
def test_a_bad_line_does_not_end_a_log_of_another_tool(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"drive.{ending}"
    with can.Logger(path) as logger:
        for number in range(20):
            logger.on_message_received(
                can.Message(timestamp=START_S + number, arbitration_id=5, data=bytes([number]), is_extended_id=False)
            )
    lines = path.read_text().splitlines()
    spoilt = next(k for k, line in enumerate(lines) if line.split()[-1:] == ["0A"])
    lines[spoilt] = lines[spoilt].replace("0A", "ZZ")
    path.write_text("\n".join(lines) + "\n")
    bad = BadRows()
    found = list(read_frames(path, bad))
    assert [data[0] for _, _, data in found] == [number for number in range(20) if number != 10]
    assert [line for line, _ in bad.first] == [spoilt + 1]
    assert found[-1][0] - found[0][0] == pytest.approx(19.0, abs=0.01)


def test_a_log_of_which_most_is_bad_is_refused(tmp_path: Path) -> None:
    (tmp_path / "bad.log").write_text("(1.0) can0 100#0A00\n" + "(2.0) can0 zzz\n" * 3)
    with pytest.raises(ImportFailed, match=r"bad\.log: 3 of 4 frames cannot be read, more than half; line 2: not"):
        list(read_frames(tmp_path / "bad.log"))


def test_a_log_with_more_values_than_memory_is_to_hold_is_refused(
    log: Path, dbc: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    n_values = 5 * 2 + 2 * 3 + 2  # the current and Level, the number and voltage of a cell, also by its name, Temps
    monkeypatch.setattr(can_log, "MOST_VALUES", n_values)
    signals = read_signals(log, dbc).found
    assert signals["PackCurrent"] is signals["Pack.PackCurrent"]  # kept once
    monkeypatch.setattr(can_log, "MOST_VALUES", n_values - 1)
    with pytest.raises(LimitExceeded, match=f"more than {n_values - 1} values.*--battery"):
        read_signals(log, dbc)
