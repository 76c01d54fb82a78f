from pathlib import Path

import numpy as np
import pytest

from app.estimation.errors import DatasetError
from app.sources.recordings.dataset import load_recording, map_of, parse_map

PLAIN = "time_s,current_a,voltage_v,temperature_c,soc\n0,0,4.1,25,1\n1,2,4.0,25,\n2,2,3.99,25.5,0.99\n"


def write(tmp_path, text, name="drive.csv"):
    path = tmp_path / name
    path.write_bytes(text.encode())
    return path


def test_columns_of_our_own_names_are_read(tmp_path):
    plain = load_recording(write(tmp_path, PLAIN))
    np.testing.assert_array_equal(plain.voltage_v, [4.1, 4.0, 3.99])
    np.testing.assert_array_equal(plain.soc, [1.0, np.nan, 0.99])
    np.testing.assert_array_equal(plain.temperature_degc, [25, 25, 25.5])


@pytest.mark.parametrize(
    "header",
    [
        "Time [s],Current [A],Voltage [V]",
        "t,I,U",
        "Test Time (s),Current(A),Cell_Voltage_V",
        "time/s,current/A,voltage/V",
        "Test (Sec),Amps,Volts",
        "time/s,<I>/A,Ecell/V",
        "Total Time,Cur(A),Voltage(V)",
        "t [s],I_cell [A],U_cell [V]",
    ],
)
def test_usual_headers_are_understood(tmp_path, header):
    recording = load_recording(write(tmp_path, f"{header}\n0,0,4.1\n1,2,4.0\n"))
    np.testing.assert_array_equal(recording.current_a, [0, 2])
    np.testing.assert_array_equal(recording.voltage_v, [4.1, 4.0])
    assert recording.notes == ()


def test_units_in_the_header_scale(tmp_path):
    recording = load_recording(write(tmp_path, "Time [min];Current [mA];Voltage [mV]\n0;0;4100,5\n1;2000;4000,0\n"))
    np.testing.assert_allclose(recording.time_s, [0, 60])
    np.testing.assert_allclose(recording.current_a, [0, 2])
    np.testing.assert_allclose(recording.voltage_v, [4.1005, 4.0])


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


def test_headerless_table_of_unusual_width_asks_for_a_map(tmp_path):
    with pytest.raises(DatasetError, match="--map"):
        load_recording(write(tmp_path, "0,0,4.1,0,25,0,25\n1,2,4.0,8,25,0,25\n"))


def test_columns_that_are_left_out_are_named(tmp_path):
    recording = load_recording(
        write(tmp_path, "time_s,current_a,voltage_v,Voltage [V],strain\n0,0,4.1,9,1\n1,2,4.0,9,1\n")
    )
    np.testing.assert_array_equal(recording.voltage_v, [4.1, 4.0])
    assert any("voltage_v is in more than one column" in note for note in recording.notes)
    assert any("columns not used: strain" in note for note in recording.notes)


def test_names_of_a_vehicle_log_are_understood_aloud(tmp_path):
    text = "Time,Pack Current (mA),Cell 1 (mV),Chamber temperature (C)\n0,0,4100,20\n1,2000,4000,20\n"
    recording = load_recording(write(tmp_path, text))
    np.testing.assert_allclose(recording.current_a, [0, 2])
    np.testing.assert_allclose(recording.voltage_v, [4.1, 4.0])
    assert np.isnan(recording.temperature_degc).all()
    notes = " ".join(recording.notes)
    assert "current_a read from column 'Pack Current (mA)'" in notes
    assert "columns not used: Chamber temperature (C)" in notes


def test_two_names_that_sound_alike_are_not_chosen_between(tmp_path):
    with pytest.raises(DatasetError, match="no column for voltage_v"):
        load_recording(write(tmp_path, "time,current,Cell 1 (V),Cell 2 (V)\n0,0,4.1,4.0\n1,2,4.0,4.0\n"))


def test_a_table_without_a_time_needs_the_time_between_its_rows(tmp_path):
    path = write(tmp_path, "current_a,voltage_v\n0,4.1\n1,4.0\n")
    with pytest.raises(DatasetError, match="no time column"):
        load_recording(path)
    assert load_recording(path, period_s=0.1).step_s[1] == pytest.approx(0.1)


def test_a_map_with_a_files_name_holds_for_that_file_in_place_of_the_others():
    entries = ["current_a=I,voltage_v=U", "slow.csv:current_a=2*0.001,voltage_v=3"]
    assert map_of(entries, Path("tests/slow.csv")) == ["current_a=2*0.001,voltage_v=3"]
    assert map_of(entries, Path("pulses.csv")) == ["current_a=I,voltage_v=U"]
    assert map_of(["time_s=clock:s"], Path("slow.csv")) == ["time_s=clock:s"], "a column may have a colon"


def test_an_unknown_field_is_refused_with_the_names_that_the_help_has():
    with pytest.raises(DatasetError, match="temperature_c, soc") as caught:
        parse_map(["warmth=3"])
    assert "temperature_degc" not in str(caught.value)
