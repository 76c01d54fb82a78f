import gzip
from pathlib import Path

import numpy as np
import pytest

from app.estimation.errors import DatasetError
from app.sources.recordings.dataset import load_recording, parse_map

SAMSUNG = Path(__file__).parents[6] / "shared" / "data" / "samsung-30q"
PLAIN = "time_s,current_a,voltage_v,temperature_c,soc\n0,0,4.1,25,1\n1,2,4.0,25,\n2,2,3.99,25.5,0.99\n"


def write(tmp_path, text, name="drive.csv"):
    path = tmp_path / name
    path.write_bytes(text.encode())
    return path


def test_plain_and_gzip_read_the_same(tmp_path):
    plain = load_recording(write(tmp_path, PLAIN))
    packed = tmp_path / "drive.csv.gz"
    packed.write_bytes(gzip.compress(PLAIN.encode()))
    np.testing.assert_array_equal(plain.voltage_v, load_recording(packed).voltage_v)
    np.testing.assert_array_equal(plain.soc, [1.0, np.nan, 0.99])
    np.testing.assert_array_equal(plain.temperature_degc, [25, 25, 25.5])


@pytest.mark.parametrize("packed", [False, True])
def test_parquet_reads_like_csv(tmp_path, packed):
    pa = pytest.importorskip("pyarrow")
    import pyarrow.parquet as pq

    path = tmp_path / "drive.parquet"
    pq.write_table(pa.table({"time_s": [0, 1], "current_a": [0.0, 1.0], "voltage_v": [4.0, None]}), path)
    if packed:
        path.write_bytes(gzip.compress(path.read_bytes()))
    recording = load_recording(path)
    np.testing.assert_array_equal(recording.voltage_v, [4.0, np.nan])


@pytest.mark.parametrize(
    "header",
    [
        "Time [s],Current [A],Voltage [V]",
        "t,I,U",
        "Test Time (s),Current(A),Cell_Voltage_V",
        "time/s,current/A,voltage/V",
    ],
)
def test_usual_headers_are_understood(tmp_path, header):
    recording = load_recording(write(tmp_path, f"{header}\n0,0,4.1\n1,2,4.0\n"))
    np.testing.assert_array_equal(recording.current_a, [0, 2])
    assert recording.notes == ()


def test_units_in_the_header_scale(tmp_path):
    recording = load_recording(write(tmp_path, "Time [min];Current [mA];Voltage [mV]\n0;0;4100,5\n1;2000;4000,0\n"))
    np.testing.assert_allclose(recording.time_s, [0, 60])
    np.testing.assert_allclose(recording.current_a, [0, 2])
    np.testing.assert_allclose(recording.voltage_v, [4.1005, 4.0])


def test_preamble_and_units_row_are_stepped_over(tmp_path):
    text = "Rig 7\nCell: 12\nTime,Current,Voltage\ns,mA,V\n0,0,4.1\n1,500,4.0\n"
    recording = load_recording(write(tmp_path, text))
    np.testing.assert_allclose(recording.current_a, [0, 0.5])
    assert any("2 lines above" in note for note in recording.notes)


def test_map_names_columns_numbers_and_factors(tmp_path):
    path = write(tmp_path, "clock,amp,volt,x\n0,0,4.1,7\n1,-2,4.0,7\n")
    recording = load_recording(path, parse_map(["time_s=clock,current_a=2*-1", "voltage_v=volt"]))
    np.testing.assert_array_equal(recording.current_a, [0, 2])


def test_map_to_a_column_that_is_not_there_lists_those_that_are(tmp_path):
    with pytest.raises(DatasetError, match="time_s, current_a, voltage_v"):
        load_recording(write(tmp_path, PLAIN), parse_map(["soc=SOH"]))


@pytest.mark.parametrize("entry", ["speed=3", "time_s", "time_s=", "current_a=I*x"])
def test_malformed_map_is_refused(entry):
    with pytest.raises(DatasetError, match="--map"):
        parse_map([entry])


def test_rows_that_are_not_numbers_become_missing(tmp_path):
    text = "time_s,current_a,voltage_v\n0,0,4.1\n1,2,overflow\n2,2\n3,2,3.9\n4,2,3.8\n"
    recording = load_recording(write(tmp_path, text))
    np.testing.assert_array_equal(recording.time_s, [0, 1, 3, 4])
    assert np.isnan(recording.voltage_v[1])
    assert any("2 rows" in note for note in recording.notes)


def test_iso_time_stamps_become_seconds(tmp_path):
    text = "timestamp,current,voltage\n2024-05-01T10:00:00,0,4.1\n2024-05-01T10:00:02.5,2,4.0\n"
    assert load_recording(write(tmp_path, text)).step_s[1] == pytest.approx(2.5)


@pytest.mark.parametrize("text", ["", "hello\nworld\n", "1\n2\n"])
def test_what_is_no_table_is_refused(tmp_path, text):
    with pytest.raises(DatasetError, match=r"drive\.csv"):
        load_recording(write(tmp_path, text))


def test_absent_file_and_broken_gzip_are_dataset_errors(tmp_path):
    with pytest.raises(DatasetError, match="cannot be read"):
        load_recording(tmp_path / "none.csv")
    broken = tmp_path / "broken.csv.gz"
    broken.write_bytes(gzip.compress(PLAIN.encode())[:-12])
    with pytest.raises(DatasetError, match="cannot be read"):
        load_recording(broken)


def test_headerless_table_of_unusual_width_asks_for_a_map(tmp_path):
    with pytest.raises(DatasetError, match="--map"):
        load_recording(write(tmp_path, "0,0,4.1,0,25,0,25\n1,2,4.0,8,25,0,25\n"))


@pytest.mark.skipif(not SAMSUNG.exists(), reason="shared measured data not present")
def test_measured_files_of_a_foreign_laboratory_load():
    mapping = parse_map(["time_s=1,current_a=2,voltage_v=3,temperature_degc=5"])
    slow = load_recording(SAMSUNG / "Q30_S001_C10.csv.gz", mapping, charge_positive=True)
    assert slow.charge_ah[-1] == pytest.approx(3.0, abs=0.1)
    pulses = load_recording(SAMSUNG / "DNN01_HPPC_2C_20amb.csv.gz", charge_positive=True, period_s=0.1)
    assert np.nanmax(pulses.soc) == pytest.approx(1.0, abs=0.01)
    with pytest.raises(DatasetError, match="no time column"):
        load_recording(SAMSUNG / "DNN01_HPPC_2C_20amb.csv.gz")


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8-sig", "latin-1"])
def test_text_of_other_encodings_reads_the_same(tmp_path, encoding):
    path = tmp_path / "run.csv"
    path.write_text("time_s,current_a,voltage_v,temperature_c\n0,1,3.7,25\n1,1,3.6,25\n", encoding=encoding)
    assert load_recording(path).voltage_v.tolist() == [3.7, 3.6]


@pytest.mark.parametrize(
    "stamps",
    [
        ("2026-05-01T12:00:00", "2026-05-01T12:00:01.5"),
        ("2026-05-01 12:00:00", "2026-05-01 12:00:01.5"),
        ("2026/05/01 12:00:00", "2026/05/01 12:00:01.5"),
        ("31.05.2026 23:59:59", "01.06.2026 00:00:00.5"),
        ("05/31/2026 23:59:59", "06/01/2026 00:00:00.5"),
        ("31/05/2026 23:59:59", "31/05/2026 23:59:00"),
        ("12:00:00", "12:00:01.5"),
        ("1d 23:59:59", "2d 00:00:00.5"),
    ],
)
def test_dates_and_clocks_are_times(tmp_path, stamps):
    recording = load_recording(write(tmp_path, f"time,current,voltage\n{stamps[0]},0,4.1\n{stamps[1]},2,4.0\n"))
    expected = 59.0 if stamps[1].endswith("59:00") else 1.5
    assert recording.step_s[1] == pytest.approx(expected)


def test_a_table_apart_by_spaces_is_read(tmp_path):
    recording = load_recording(write(tmp_path, "time current  voltage\n0  0 4.1\n1  2 4.0\n"))
    np.testing.assert_array_equal(recording.voltage_v, [4.1, 4.0])


def test_a_delimiter_after_the_last_column_is_no_column(tmp_path):
    recording = load_recording(write(tmp_path, "time_s,current_a,voltage_v\n0,0,4.1,\n1,2,4.0,\n"))
    np.testing.assert_array_equal(recording.current_a, [0, 2])
    empty = load_recording(write(tmp_path, "time_s,current_a,voltage_v,soc\n0,0,4.1,\n1,2,4.0,\n"))
    assert np.isnan(empty.soc).all()


def test_a_broken_first_row_does_not_hide_the_header(tmp_path):
    rows = "".join(f"{k},{'err' if k == 0 else 2},4.0\n" for k in range(10))
    recording = load_recording(write(tmp_path, f"Zeit,Strom,Spannung\n{rows}"))
    np.testing.assert_array_equal(recording.time_s, np.arange(1, 10))
    assert any("1 rows" in note for note in recording.notes)


def test_columns_that_are_left_out_are_named(tmp_path):
    recording = load_recording(
        write(tmp_path, "time_s,current_a,voltage_v,Voltage [V],strain\n0,0,4.1,9,1\n1,2,4.0,9,1\n")
    )
    np.testing.assert_array_equal(recording.voltage_v, [4.1, 4.0])
    assert any("voltage_v is in more than one column" in note for note in recording.notes)
    assert any("columns not used: strain" in note for note in recording.notes)


def test_a_file_without_numbers_says_what_stands_there(tmp_path):
    with pytest.raises(DatasetError, match="line 2 is 'no numbers, here'"):
        load_recording(write(tmp_path, "a,b\nno numbers, here\n"))


RIG = "Rec,Step,Test time (hh:mm:ss),I/mA,Potential/V,State\n" + "".join(
    f"{k},1,0:00:{k:06.3f},{500 * (k % 2)},{4.0 - 0.05 * (k % 2)},{'run' if k else 'pause'}\n" for k in range(8)
)


def test_columns_of_words_do_not_hide_the_numbers(tmp_path):
    recording = load_recording(write(tmp_path, RIG))
    np.testing.assert_array_equal(recording.time_s, np.arange(8.0))
    np.testing.assert_allclose(recording.current_a, 0.5 * (np.arange(8) % 2))
    np.testing.assert_allclose(recording.voltage_v, 4.0 - 0.05 * (np.arange(8) % 2))


def test_a_row_of_another_width_among_words_is_left_out_aloud(tmp_path):
    recording = load_recording(write(tmp_path, RIG + "8,1,0:00:08.000,0,4.0,run,9,9\n"))
    assert len(recording.time_s) == 8
    assert any("1 rows are not 6 columns" in note for note in recording.notes)


def test_a_date_is_the_time_only_where_there_is_no_other(tmp_path):
    row = "2026-05-01 12:00:{:02d},{},{},4.0\n"
    stamped = "DateTime,{},Current(A),Voltage(V)\n" + "".join(row.format(k, 10 * k, 1) for k in range(4))
    by_date = load_recording(write(tmp_path, stamped.format("Cycle")))
    assert by_date.time_s[-1] - by_date.time_s[0] == 3.0
    by_clock = load_recording(write(tmp_path, stamped.format("Test_Time(s)")))
    assert by_clock.time_s[-1] - by_clock.time_s[0] == 30.0


@pytest.mark.parametrize(
    "header",
    ["Test (Sec),Amps,Volts", "time/s,<I>/A,Ecell/V", "Total Time,Cur(A),Voltage(V)", "t [s],I_cell [A],U_cell [V]"],
)
def test_headers_of_common_test_rigs_are_understood(tmp_path, header):
    recording = load_recording(write(tmp_path, header + "\n0,0,4.1\n1,2,4.0\n2,2,3.9\n"))
    np.testing.assert_array_equal(recording.current_a, [0, 2, 2])
    np.testing.assert_array_equal(recording.voltage_v, [4.1, 4.0, 3.9])


@pytest.mark.parametrize("kind", ["timestamp", "duration"])
def test_parquet_times_of_either_kind_are_seconds(tmp_path, kind):
    pa = pytest.importorskip("pyarrow")
    import pyarrow.parquet as pq

    nanos = pa.array([1_500_000_001, 2_000_000_002, 2_500_000_003])
    stamps = nanos.cast(pa.timestamp("ns", "UTC") if kind == "timestamp" else pa.duration("ns"))
    path = tmp_path / "drive.parquet"
    pq.write_table(pa.table({"time": stamps, "current_a": [0.0, 1.0, 1.0], "voltage_v": [4.0, 3.9, 3.9]}), path)
    np.testing.assert_allclose(np.diff(load_recording(path).time_s), 0.5, atol=2e-6)


def test_names_of_a_vehicle_log_are_understood_aloud(tmp_path):
    text = "Time,Pack Current (mA),Cell 1 (mV),Chamber temperature (C)\n0,0,4100,20\n1,2000,4000,20\n"
    recording = load_recording(write(tmp_path, text))
    np.testing.assert_allclose(recording.current_a, [0, 2])
    np.testing.assert_allclose(recording.voltage_v, [4.1, 4.0])
    assert np.isnan(recording.temperature_degc).all()
    notes = " ".join(recording.notes)
    assert "current_a taken from the column 'Pack Current (mA)'" in notes
    assert "columns not used: Chamber temperature (C)" in notes


def test_two_names_that_sound_alike_are_not_chosen_between(tmp_path):
    with pytest.raises(DatasetError, match="no column for voltage_v"):
        load_recording(write(tmp_path, "time,current,Cell 1 (V),Cell 2 (V)\n0,0,4.1,4.0\n1,2,4.0,4.0\n"))


@pytest.mark.parametrize(("unit", "values"), [("K", "298.15,298.15"), ("F", "77,77"), ("degC", "25,25")])
def test_temperatures_of_any_unit_in_the_header_are_degrees_celsius(tmp_path, unit, values):
    first, second = values.split(",")
    text = f"time,current,voltage,Temp [{unit}]\n0,0,4.1,{first}\n1,2,4.0,{second}\n"
    np.testing.assert_allclose(load_recording(write(tmp_path, text)).temperature_degc, [25, 25])
