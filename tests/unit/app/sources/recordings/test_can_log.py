"""CAN logs: every format, bus logging as asammdf writes it, signals held and cut, cells by an index, broken files."""

import contextlib
import gc
import gzip
import sys
import warnings
from pathlib import Path

import can
import numpy as np
import pytest

from app.cli import main
from app.errors import ExtraMissing, ImportFailed, LimitExceeded
from app.sources.dbc import frames as columns
from app.sources.dbc.frames import load_log
from app.sources.recordings import log_signals, mf4_log
from app.sources.recordings.bad_rows import BadRows
from app.sources.recordings.can_log import read_frames
from app.sources.recordings.import_mapping import ImportMapping
from app.sources.recordings.log_signals import column_mapping, one_signal, read_signals
from app.words import render
from firmware_protocol.memory_map import CAN_ID_EXTENDED
from tests.recorded.mf4 import write_mf4
from tests.recorded.peer_sessions import START_S

DBC = """\
VERSION ""
BU_: BMS
BO_ 256 Pack: 4 BMS
 SG_ Current : 0|16@1- (0.1,0) [0|0] "A" X
 SG_ Soc : 16|8@1+ (1,0) [0|0] "%" X
BO_ 2147484160 Cells: 3 BMS
 SG_ CellID : 0|8@1+ (1,0) [0|0] "" X
 SG_ Voltage : 8|16@1+ (0.001,0) [0|0] "V" X
BO_ 300 Other: 2 BMS
 SG_ Soc : 0|8@1+ (1,0) [0|0] "%" X
 SG_ Mode : 8|8@1+ (1,0) [0|0] "" X
VAL_ 300 Mode 1 "charge" ;
"""
PACK, CELLS, OTHER = 256, 0x200 | CAN_ID_EXTENDED, 300
T0 = 1_780_000_000.0
PROFILE = ImportMapping(current="Current", voltages="Voltage[CellID]", soc="Pack.Soc", hold_s=1.0)


def pack(at_s, current_a, soc=50):
    return at_s, PACK, round(current_a * 10).to_bytes(2, "little", signed=True) + bytes([soc, 0])


def cell(at_s, number, volts):
    return at_s, CELLS, bytes([number]) + round(volts * 1000).to_bytes(2, "little")


# Two seconds: the current every 0.5 s, each of two cells once.
DRIVE = (pack(0, 12.3), cell(0.2, 0, 3.6), cell(0.4, 1, 3.7), *(pack(k / 2, -k) for k in range(1, 5)))


@pytest.fixture
def dbc(tmp_path):
    path = tmp_path / "bus.dbc"
    path.write_text(DBC, encoding="utf-8")
    return path


@pytest.fixture
def log(tmp_path):
    def write(*frames, ending="log"):
        path = tmp_path / f"drive.{ending}"
        with can.Logger(path) as logger:
            for at_s, can_id, data in frames:
                logger.on_message_received(
                    can.Message(timestamp=T0 + at_s, arbitration_id=can_id & 0x1FFFFFFF, data=data, channel="can0",
                                is_extended_id=bool(can_id >> 31), is_fd=len(data) > 8)
                )  # fmt: skip
        return path

    return write


@pytest.mark.parametrize(("ending", "with_fd"), [("log", True), ("asc", True), ("blf", True), ("trc", False)])
def test_logs_of_every_tool_are_the_same_frames(log, ending, with_fd):
    frames = [(0.0, 0x123, bytes(range(8))), (0.25, 0x18FF50E5 | CAN_ID_EXTENDED, b"\x01\x02"), (0.5, 0x7FF, b"")]
    frames += [(1.0, 0x345, bytes(range(64)))] * with_fd
    found = load_log(log(*frames, ending=ending))
    assert found.can_id.tolist() == [can_id for _, can_id, _ in frames]
    assert [bytes(row[:n]) for row, n in zip(found.data, found.length, strict=True)] == [data for *_, data in frames]
    np.testing.assert_allclose((found.t_ns - found.t_ns[0]) / 1e9, [at_s for at_s, *_ in frames], atol=2e-3)


def test_frames_are_put_in_the_order_of_their_time_whatever_part_of_a_log_is_taken_at_once(tmp_path, monkeypatch):
    path = tmp_path / "mixed.log"
    lines = [f"({9 - k // 2}.0) can0 {0x100 + k:03X}#{k:02X}" for k in range(7)] + ["(3.5) can0 700##1" + "AB" * 64]
    path.write_text("\n".join(lines) + "\n")
    whole = load_log(path)
    assert whole.data.shape == (8, 64)
    assert whole.can_id.tolist() == [
        0x700,
        0x106,
        0x104,
        0x105,
        0x102,
        0x103,
        0x100,
        0x101,
    ]  # equal times stay in order
    monkeypatch.setattr(columns, "AT_ONCE", 3)
    parts = load_log(path)
    for name in ("t_ns", "can_id", "length", "data"):
        assert getattr(parts, name).tolist() == getattr(whole, name).tolist()
        assert getattr(parts, name).dtype == getattr(whole, name).dtype


@pytest.mark.parametrize("ending", ["log", "blf"])
def test_remote_and_error_frames_carry_nothing(tmp_path, ending):
    path = tmp_path / f"bus.{ending}"
    with can.Logger(path) as logger:
        for message in (
            can.Message(timestamp=1.0, arbitration_id=1, is_remote_frame=True, channel="can0"),
            can.Message(timestamp=1.0, is_error_frame=True, channel="can0"),
            can.Message(timestamp=1.0, arbitration_id=2, data=b"x", channel="can0"),
        ):
            logger.on_message_received(message)
    assert [frame[1] for frame in read_frames(path)] == [2 | CAN_ID_EXTENDED]


def test_a_row_is_a_frame_with_the_current_and_others_are_held(log, dbc):
    table = read_signals(log(*DRIVE), dbc).table(PROFILE)
    assert table.columns["time"] == pytest.approx(T0 + np.arange(5) / 2)
    assert table.columns["Current"] == pytest.approx([12.3, -1, -2, -3, -4])
    for number, volts in ((0, 3.6), (1, 3.7)):  # older than 1 s: missing
        found = table.columns[f"Voltage[{number}]"]
        assert found == pytest.approx([np.nan, volts, volts, np.nan, np.nan], nan_ok=True)
    assert column_mapping(PROFILE) == {"time": "time", "time_unit": "s", "voltages": "Voltage[{n}]"}


@pytest.mark.parametrize(("gap_s", "is_held"), [(0.99, True), (1.01, False)])
def test_a_signal_counts_as_long_as_it_is_held(log, dbc, gap_s, is_held):
    table = read_signals(log(cell(0, 0, 3.6), pack(gap_s, 1.0)), dbc).table(PROFILE)
    assert np.isfinite(table.columns["Voltage[0]"][0]) == is_held


def test_the_columns_of_a_log_are_those_of_its_frames_and_a_name_of_two_messages_needs_its_message(log, dbc):
    assert set(read_signals(log(pack(0, 1.0), (0.1, 0x7FF, b"\0")), dbc).by_name) == {
        "Current",
        "Pack.Current",
        "Pack.Soc",
    }
    names = set(read_signals(log(*DRIVE, (3, OTHER, b"\x00\x01")), dbc).by_name)
    assert {"Pack.Soc", "Other.Soc", "Current", "Pack.Current", "Voltage[1]"} <= names
    assert "Soc" not in names


@pytest.mark.parametrize(
    ("frames", "signal", "times_s", "expected"),
    [
        (DRIVE, "Pack.Current", np.arange(5) / 2, [12.3, -1, -2, -3, -4]),
        ([(0, OTHER, b"\x00\x01")], "Mode", [0], [1]),  # a word by its number
        ([(0, PACK, b"\x0a\x00"), pack(0.1, 2.0)], "Current", [0, 0.1], [1.0, 2.0]),  # a frame that is cut
        ([(0, PACK, b"\x0a\x00"), pack(0.1, 2.0)], "Pack.Soc", [0.1], [50.0]),
    ],
)
def test_one_signal_is_read_out_of_frames(log, dbc, frames, signal, times_s, expected):
    found_s, values = one_signal(read_frames(log(*frames)), "drive.log", dbc, signal)
    assert found_s == pytest.approx(T0 + np.array(times_s))
    assert values == pytest.approx(expected)


def test_what_is_in_no_frame_is_named(log, dbc):
    with pytest.raises(ImportFailed, match="current = 'Amps'"):
        read_signals(log(*DRIVE), dbc).table(ImportMapping(current="Amps", voltages="Voltage[CellID]"))
    path = log((0, 0x7FF, b"\1"), (0.1, PACK | CAN_ID_EXTENDED, bytes(4)))
    with pytest.raises(ImportFailed, match=r"drive\.log: no frame matches bus\.dbc"):
        sorted(read_signals(path, dbc).by_name)
    with pytest.raises(ImportFailed, match=r"no frame with the signal Current of bus\.dbc"):
        one_signal(read_frames(path), "drive.log", dbc, "Current")


python_can_leaves_the_file_open = pytest.mark.filterwarnings(
    "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)


@python_can_leaves_the_file_open
@pytest.mark.parametrize(
    ("name", "content", "why"),
    [
        ("no.blf", b"hello", "not a readable CAN log"),
        ("none.log", None, "not a readable CAN log"),
        ("none.blf", None, "not a readable CAN log"),
        ("no.mf4", b"\x00\xff\x80 this is no log\n" * 9, "not a readable CAN log"),
        ("no.log", b"hello there you\n", "1 of 1 frames cannot be read"),
        ("no.log", b"\x00\xff\x80 this is no log\n" * 9, "not a readable CAN log"),
        ("no.log", b"(1.0) can0 100#0A00\n" + b"(2.0) can0 zzz\n" * 3,
         "3 of 4 frames cannot be read .more than half.; line 2: expected"),
    ],
)  # fmt: skip
def test_what_is_no_log_or_mostly_none_is_refused_by_name(tmp_path, name, content, why):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(ImportFailed, match=rf"{name}: .*{why}"):
        list(read_frames(tmp_path / name))


@python_can_leaves_the_file_open
def test_a_damaged_log_is_refused_or_read_as_far_as_it_can_be(log, tmp_path):
    whole = log(*(pack(i / 10, 1.0) for i in range(200)), ending="blf").read_bytes()
    for content in (bytes(200), whole[:100], whole[:-50], whole[:300] + bytes(40) + whole[340:]):
        (tmp_path / "no.blf").write_bytes(content)
        with contextlib.suppress(ImportFailed):
            list(read_frames(tmp_path / "no.blf"))


@python_can_leaves_the_file_open
@pytest.mark.parametrize(("ending", "text"), [("log", ""), ("log", "\n"), ("asc", ""), ("trc", "")])
def test_an_empty_log_has_no_frame(tmp_path, ending, text):
    path = tmp_path / f"empty.{ending}"
    path.write_text(text)
    assert list(read_frames(path)) == []


def test_frames_that_a_log_tells_late_count_at_their_own_time(tmp_path, dbc):
    frames = [
        "(3.0) can1 00000200#00CC10",  # cell 0, the newer one first
        "(1.0) can0 100#0A00",
        "(2.0) can1 00000200#00100E",
        "(3.5) can0 100#1E00",
        "(2.5) can0 100#1400",
    ]
    (tmp_path / "late.log").write_text("\n".join(frames) + "\n")
    table = read_signals(tmp_path / "late.log", dbc).table(PROFILE)
    np.testing.assert_array_equal(table.columns["time"], [1.0, 2.5, 3.5])
    np.testing.assert_allclose(table.columns["Current"], [1.0, 2.0, 3.0])
    np.testing.assert_allclose(table.columns["Voltage[0]"], [np.nan, 3.6, 4.3])


def test_a_bad_line_or_frame_does_not_end_a_log(tmp_path, dbc):
    lines = [f"({k}.0) can0 100#0A003200" for k in range(40)]
    lines[7] = "(7.0) can0 1x0#0A00"
    lines[9] = "(nan) can0 100#0A00"
    (tmp_path / "bad.log").write_text("\n".join(lines) + "\n(40.0) can0 10")  # and the end cut off
    bad = BadRows()
    assert len(list(read_frames(tmp_path / "bad.log", bad))) == 38
    assert [line for line, _ in bad.first] == [8, 10]
    table = read_signals(tmp_path / "bad.log", dbc).table(ImportMapping(current="Current", voltages="Soc"))
    assert len(table.columns["time"]) == 38
    assert any("2 of 40 frames unreadable" in note and "line 8" in note for note in map(render, table.notes))


@pytest.mark.parametrize("ending", ["asc", "trc"])
def test_a_bad_line_does_not_end_a_log_of_another_tool(log, ending):
    path = log(*((number, 5, bytes([number])) for number in range(20)), ending=ending)
    lines = path.read_text().splitlines()
    spoilt = next(k for k, line in enumerate(lines) if line.split()[-1:] == ["0A"])
    lines[spoilt] = lines[spoilt].replace("0A", "ZZ")
    path.write_text("\n".join(lines) + "\n")
    bad = BadRows()
    found = list(read_frames(path, bad))
    assert [data[0] for _, _, data in found] == [number for number in range(20) if number != 10]
    assert [line for line, _ in bad.first] == [spoilt + 1]
    assert found[-1][0] - found[0][0] == pytest.approx(19.0, abs=0.01)


def test_a_log_with_more_values_than_memory_is_to_hold_is_refused(log, dbc, monkeypatch):
    path = log(*DRIVE)
    n_values = 5 * 2 + 2 * 3  # the current and the SOC, the number and voltage of a cell, also by its name
    monkeypatch.setattr(log_signals, "MOST_VALUES", n_values)
    signals = read_signals(path, dbc).by_name
    assert signals["Current"] is signals["Pack.Current"]  # kept once
    monkeypatch.setattr(log_signals, "MOST_VALUES", n_values - 1)
    with pytest.raises(LimitExceeded, match=f"more than {n_values - 1} values.*--battery"):
        read_signals(path, dbc)


def test_relative_times_of_an_asc_log_are_added_up(tmp_path):
    lines = [f"   {dt} 1  {can_id}             Rx   d 1 0{k}\n" for k, (dt, can_id) in enumerate(
        [("0.010000", "123"), ("0.020000", "124"), ("0.030000", "123")]
    )]  # fmt: skip
    log = tmp_path / "x.asc"
    log.write_text(
        "date Tue May 3 10:00:00 2022\nbase hex  timestamps relative\nno internal events logged\n" + "".join(lines)
    )
    times = [t_s for t_s, _, _ in read_frames(log)]
    np.testing.assert_allclose(np.diff(times), [0.02, 0.03], atol=1e-6)
    log.write_text(log.read_text().replace("relative", "absolute"))
    np.testing.assert_allclose(np.diff([t_s for t_s, _, _ in read_frames(log)]), [0.01, 0.01], atol=1e-6)


def zipped(path: Path) -> Path:
    """The same log, packed."""
    packed = path.with_name(f"packed.{path.name}.gz")
    packed.write_bytes(gzip.compress(path.read_bytes()))
    return packed


@pytest.mark.parametrize("ending", ["log", "blf", "asc", "trc"])
def test_a_reader_tells_how_much_of_the_file_is_read(log, ending):
    path = log(*(pack(number / 10, 1.0) for number in range(50)), ending=ending)
    positions = []
    assert len(list(read_frames(path, on_read=positions.append))) == 50
    assert positions == sorted(positions)
    assert positions[-1] == path.stat().st_size


def test_of_a_packed_log_it_tells_how_much_of_the_packed_file_is_read(log):
    path = log(*(pack(number / 10, 1.0) for number in range(50)))
    packed, positions = zipped(path), []
    assert list(read_frames(packed, on_read=positions.append)) == list(read_frames(path))
    assert positions[-1] == packed.stat().st_size < path.stat().st_size


@pytest.mark.parametrize(
    ("ending", "is_packed"), [("log", False), ("log", True), ("asc", False), ("asc", True), ("blf", False)]
)
def test_a_log_of_which_only_the_beginning_is_read_is_closed(log, ending, is_packed):
    """Else the end of the process, or of a test, warns of an open file."""
    path = log(*(pack(number / 10, 1.0) for number in range(50)), ending=ending)
    with warnings.catch_warnings():
        warnings.simplefilter("error", ResourceWarning)
        frames = read_frames(zipped(path) if is_packed else path)
        assert next(frames)[1] == PACK
        frames.close()
        gc.collect()


@pytest.mark.parametrize("has_ide", [True, False])
def test_frames_of_all_buses_come_in_the_order_of_time_with_their_bytes(tmp_path: Path, has_ide: bool) -> None:
    first = [(0.1, 0x123, b"\x01\x02"), (0.3, 0x18FF50E5 | CAN_ID_EXTENDED, bytes(8))]
    second = [(0.2, 0x7FF, bytes(range(64))), (0.4, 0x1, b"")]
    path = write_mf4(tmp_path / "run.mf4", first, second, has_ide=has_ide)
    found = list(read_frames(path))
    expected = sorted(first + second)
    assert [(can_id, data) for _, can_id, data in found] == [(can_id, data) for _, can_id, data in expected]
    assert [time_s for time_s, _, _ in found] == pytest.approx([START_S + time_s for time_s, _, _ in expected])


def test_a_file_without_frames_says_so(tmp_path: Path) -> None:
    import asammdf  # here: with pandas it takes half a second of every test process

    file = asammdf.MDF(version="4.11")
    file.append(asammdf.Signal(np.arange(3.0), np.arange(3.0), name="speed"))
    file.save(tmp_path / "run.mf4")
    file.close()
    with pytest.raises(ImportFailed, match="CAN_DataFrame"):
        list(read_frames(tmp_path / "run.mf4"))


def test_frames_come_in_pieces_and_none_is_lost_between_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mf4_log, "AT_ONCE", 3)
    frames = [(0.1 * k, 0x100 + k, bytes([k])) for k in range(8)]
    found = list(read_frames(write_mf4(tmp_path / "run.mf4", frames[::2], frames[1::2])))
    assert [(can_id, data) for _, can_id, data in found] == [(can_id, data) for _, can_id, data in frames]


def test_without_asammdf_the_line_to_install_it_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "asammdf", None)
    (tmp_path / "run.mf4").write_bytes(b"MDF ")
    with pytest.raises(ExtraMissing, match=r"pip install .*mf4"):
        list(read_frames(tmp_path / "run.mf4"))


def test_a_blf_whose_container_has_no_size_is_refused_in_one_line(tmp_path, capsys):
    path = tmp_path / "damaged.blf"
    with can.BLFWriter(path) as writer:
        writer.on_message_received(can.Message(timestamp=1.78e9, arbitration_id=0x100, data=b"12"))
    raw = bytearray(path.read_bytes())
    raw[raw.index(b"LOBJ") + 8 : raw.index(b"LOBJ") + 12] = bytes(4)
    path.write_bytes(raw)
    assert main(["sessions", "import", str(path), "--data", str(tmp_path)]) != 0
    assert capsys.readouterr().err.count("\n") == 1
