"""CAN logs where they are odd: every format, held and cut signals, cells by an index, broken files."""

import contextlib
import gc
import gzip
import warnings

import can
import numpy as np
import pytest

from app.errors import ImportFailed
from app.sources.recordings.can_log import column_profile, one_signal, read_frames, read_signals
from app.sources.recordings.profile import ImportProfile

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
PACK, CELLS, OTHER = 256, 0x200 | 1 << 31, 300
T0 = 1_780_000_000.0
PROFILE = ImportProfile(current="Current", voltages="Voltage[CellID]", soc="Pack.Soc", hold_s=1.0)


def pack(at_s, current_a, soc=50):
    return at_s, PACK, round(current_a * 10).to_bytes(2, "little", signed=True) + bytes([soc, 0])


def cell(at_s, number, volts):
    return at_s, CELLS, bytes([number]) + round(volts * 1000).to_bytes(2, "little")


@pytest.fixture
def files(tmp_path):
    dbc = tmp_path / "bus.dbc"
    dbc.write_text(DBC, encoding="utf-8")

    def log(*frames, ending="log"):
        path = tmp_path / f"drive.{ending}"
        with can.Logger(path) as logger:
            for at_s, can_id, data in frames:
                logger.on_message_received(
                    can.Message(timestamp=T0 + at_s, arbitration_id=can_id & 0x1FFFFFFF, data=data, channel="can0",
                                is_extended_id=bool(can_id >> 31))
                )  # fmt: skip
        return path

    return log, dbc


@pytest.mark.parametrize("ending", ["log", "blf", "asc"])
def test_frames_come_in_order_with_their_format(files, ending):
    log, _ = files
    frames = list(read_frames(log(pack(0, 1.5), cell(0.25, 3, 3.7), ending=ending)))
    assert [(can_id, data) for _, can_id, data in frames] == [pack(0, 1.5)[1:], cell(0, 3, 3.7)[1:]]
    assert frames[1][0] - frames[0][0] == pytest.approx(0.25, abs=1e-3)


@pytest.mark.parametrize(("gap_s", "is_held"), [(0.99, True), (1.01, False)])
def test_a_signal_counts_as_long_as_it_is_held(files, gap_s, is_held):
    log, dbc = files
    table = read_signals(log(cell(0, 0, 3.6), pack(gap_s, 1.0)), dbc).table(PROFILE)
    assert np.isfinite(table.columns["Voltage[0]"][0]) == is_held


def test_each_cell_has_a_column_by_the_index_in_its_message(files):
    log, dbc = files
    frames = [cell(n / 100, n, 3.6 + n / 100) for n in range(12)]
    table = read_signals(log(*frames, pack(0.5, 0.0)), dbc).table(PROFILE)
    assert [round(table.columns[f"Voltage[{n}]"][0], 3) for n in range(12)] == [
        round(3.6 + n / 100, 3) for n in range(12)
    ]
    assert column_profile(PROFILE) == {"time": "time", "time_unit": "s", "voltages": "Voltage[{n}]"}


def test_a_word_is_told_by_its_number(files):
    log, dbc = files
    _, values = one_signal(read_frames(log((0, OTHER, b"\x00\x01"))), "drive.log", dbc, "Mode")
    np.testing.assert_array_equal(values, [1])


def test_a_frame_that_is_cut_tells_the_signals_it_has(files):
    log, dbc = files
    path = log((0, PACK, b"\x0a\x00"), pack(0.1, 2.0))
    times_s, values = one_signal(read_frames(path), "drive.log", dbc, "Current")
    np.testing.assert_allclose(values, [1.0, 2.0])
    assert len(one_signal(read_frames(path), "drive.log", dbc, "Pack.Soc")[0]) == 1
    assert len(times_s) == 2


def test_a_log_without_a_message_of_the_dbc_is_refused(files):
    log, dbc = files
    path = log((0, 0x7FF, b"\1"), (0.1, 256 | 1 << 31, bytes(4)))
    with pytest.raises(ImportFailed, match=r"drive\.log: none of its frames is in bus\.dbc"):
        sorted(read_signals(path, dbc).found)
    with pytest.raises(ImportFailed, match="none of its frames with a signal Current is in"):
        one_signal(read_frames(path), "drive.log", dbc, "Current")


@pytest.mark.filterwarnings(
    "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)  # of python-can
def test_files_that_are_something_else_are_refused_by_name(files, tmp_path):
    log, _ = files
    whole = log(*(pack(i / 10, 1.0) for i in range(200)), ending="blf").read_bytes()
    for content in (b"hello", bytes(200), whole[:100], whole[:-50], whole[:300] + bytes(40) + whole[340:]):
        (tmp_path / "no.blf").write_bytes(content)
        with contextlib.suppress(ImportFailed):  # or what of it can be read; nothing else
            list(read_frames(tmp_path / "no.blf"))
    (tmp_path / "no.blf").write_bytes(b"hello")
    with pytest.raises(ImportFailed, match=r"no\.blf: not a readable CAN log"):
        list(read_frames(tmp_path / "no.blf"))
    with pytest.raises(ImportFailed, match="not a readable CAN log"):
        list(read_frames(tmp_path / "none.log"))
    (tmp_path / "no.dbc").write_text("BO_ 1 two words: x", encoding="utf-8")
    with pytest.raises(ImportFailed, match=r"no\.dbc: not a readable DBC"):
        sorted(read_signals(log(pack(0, 1.0)), tmp_path / "no.dbc").found)


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


@pytest.mark.parametrize("ending", ["log", "blf", "asc", "trc"])
def test_a_reader_tells_how_much_of_the_file_is_read(files, ending):
    log, _ = files
    path = log(*(pack(number / 10, 1.0) for number in range(50)), ending=ending)
    positions = []
    assert len(list(read_frames(path, on_read=positions.append))) == 50
    assert positions == sorted(positions)
    assert positions[-1] == path.stat().st_size


def test_of_a_packed_log_it_tells_how_much_of_the_packed_file_is_read(files, tmp_path):
    log, _ = files
    path = log(*(pack(number / 10, 1.0) for number in range(50)))
    packed = tmp_path / "drive.log.gz"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    positions = []
    assert list(read_frames(packed, on_read=positions.append)) == list(read_frames(path))
    assert positions[-1] == packed.stat().st_size < path.stat().st_size


@pytest.mark.parametrize("is_packed", [False, True])
@pytest.mark.parametrize("ending", ["log", "asc", "blf"])
def test_a_log_of_which_only_the_beginning_is_read_is_closed(files, tmp_path, ending, is_packed):
    """Else the end of the process, or of a test, warns of an open file."""
    log, _ = files
    path = log(*(pack(number / 10, 1.0) for number in range(50)), ending=ending)
    if is_packed and ending != "blf":
        packed = tmp_path / f"packed.{ending}.gz"
        packed.write_bytes(gzip.compress(path.read_bytes()))
        path = packed
    with warnings.catch_warnings():
        warnings.simplefilter("error", ResourceWarning)
        frames = read_frames(path)
        assert next(frames)[1] == PACK
        frames.close()
        gc.collect()


@pytest.mark.parametrize("text", ["", "\n"])
def test_an_empty_log_has_no_frame(tmp_path, text):
    path = tmp_path / "empty.log"
    path.write_text(text)
    assert list(read_frames(path)) == []
