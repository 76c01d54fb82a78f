import re

import numpy as np
import pytest

from app.estimation.errors import DatasetError
from app.estimation.recording.cell_recording import believable, clean


def columns(**changes):
    base = {
        "time_s": np.arange(6.0),
        "current_a": np.array([0.0, 2.0, 2.0, 2.0, 0.0, 0.0]),
        "voltage_v": np.array([4.0, 3.9, 3.89, 3.88, 3.95, 3.96]),
    }
    return {name: np.asarray(values, dtype=float) for name, values in {**base, **changes}.items() if values is not None}


def test_clean_columns_pass_unchanged_and_without_notes():
    recording = clean("a", columns())
    assert recording.notes == ()
    np.testing.assert_array_equal(recording.voltage_v, columns()["voltage_v"])
    assert np.isnan(recording.temperature_degc).all()
    assert recording.charge_ah[-1] == pytest.approx(6.0 / 3600.0)


def test_charge_positive_source_is_turned():
    recording = clean("a", columns(current_a=[0, -2, -2, -2, 0, 0]), charge_positive=True)
    np.testing.assert_array_equal(recording.current_a, columns()["current_a"])


def test_wrong_sign_is_uncertaintyed_aloud():
    notes = clean("a", columns(current_a=[0, -2, -2, -2, 0, 0])).notes
    assert any("--charge-positive" in note for note in notes)


def test_missing_time_needs_a_period():
    with pytest.raises(DatasetError, match="--period"):
        clean("a", columns(time_s=None))
    recording = clean("a", columns(time_s=None), period_s=0.5)
    np.testing.assert_allclose(recording.time_s, 0.5 * np.arange(6))


def test_missing_voltage_column_names_the_way_out():
    with pytest.raises(DatasetError, match="--map voltage_v"):
        clean("drive.csv", columns(voltage_v=None))


def test_rows_without_current_are_left_out_and_missing_voltage_is_kept():
    recording = clean("a", columns(current_a=[0, 2, np.nan, 2, 0, 0], voltage_v=[4, 3.9, 3.89, np.nan, 3.95, 3.96]))
    assert len(recording.time_s) == 5
    assert np.isnan(recording.voltage_v).sum() == 1
    assert len(recording.notes) == 2


def test_exact_repeats_go_and_the_two_rows_of_a_step_stay():
    recording = clean(
        "a",
        {
            "time_s": np.array([0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 4.0, 5.0, 6.0]),
            "current_a": np.array([0.0, 0.0, 0.0, 0.0, 5.0, 5.0, 5.0, 5.0, 5.0]),
            "voltage_v": np.array([4.0, 4.0, 4.0, 4.0, 3.8, 3.79, 3.78, 3.77, 3.76]),
        },
    )
    np.testing.assert_array_equal(recording.time_s, [0.0, 1.0, 2.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    np.testing.assert_array_equal(recording.current_a[2:4], [0.0, 5.0])


def test_whole_second_clock_at_ten_hertz_is_spread():
    time_s = np.repeat(np.arange(5.0), 10)
    recording = clean("a", {"time_s": time_s, "current_a": np.ones(50), "voltage_v": np.full(50, 3.7)})
    np.testing.assert_allclose(recording.time_s, 0.1 * np.arange(50), atol=1e-12)


@pytest.mark.parametrize(
    ("name", "values", "clean_values"),
    [
        ("voltage_v", [4000, 3900, 3890, 3880, 3950, 3960], [4.0, 3.9, 3.89, 3.88, 3.95, 3.96]),
        ("temperature_degc", [298.15] * 6, [25.0] * 6),
        ("soc", [100, 99, 98, 97, 97, 97], [1.0, 0.99, 0.98, 0.97, 0.97, 0.97]),
    ],
)
def test_foreign_units_are_recognised_and_noted(name, values, clean_values):
    recording = clean("a", columns(**{name: values}))
    np.testing.assert_allclose(getattr(recording, name), clean_values)
    assert len(recording.notes) == 1


def test_voltage_of_a_whole_accumulator_is_refused():
    with pytest.raises(DatasetError, match="one cell"):
        clean("a", columns(voltage_v=[400, 390, 389, 388, 395, 396]))


def test_gap_is_reported_and_kept():
    recording = clean("a", columns(time_s=[0, 1, 2, 3, 4, 3600]))
    assert recording.step_s[-1] == 3596
    assert any("gap" in note for note in recording.notes)


def test_missing_temperature_is_held():
    recording = clean("a", columns(temperature_degc=[np.nan, 20, np.nan, 22, np.nan, np.nan]))
    np.testing.assert_array_equal(recording.temperature_degc, [20, 20, 20, 22, 22, 22])


def test_a_clock_that_stands_still_is_refused_with_a_way_out():
    with pytest.raises(DatasetError, match="--period"):
        clean("x", {"time_s": np.zeros(20), "current_a": np.arange(20.0), "voltage_v": np.full(20, 3.7)})


def test_a_column_of_zeros_is_no_cell_voltage():
    with pytest.raises(DatasetError, match="voltage_v"):
        clean("x", {"time_s": np.arange(20.0), "current_a": np.ones(20), "voltage_v": np.zeros(20)})


def test_milliamperes_taken_for_amperes_are_refused_by_field_and_factor():
    columns = {"time_s": np.arange(20.0), "current_a": np.full(20, 5000.0), "voltage_v": np.full(20, 3.7)}
    with pytest.raises(DatasetError, match=r"x: current_a is usually 5000 A.*0\.001"):
        believable(clean("x", columns), 3.0)
    believable(clean("x", columns | {"current_a": np.full(20, 5.0)}), 3.0)
    believable(clean("x", columns | {"current_a": np.zeros(20)}), 3.0)


def test_values_of_a_broken_channel_become_missing_aloud():
    voltage = [4.0, 3.9, 65.535, 0.0, 3.95, 3.96]
    recording = clean("a", columns(voltage_v=voltage, temperature_degc=[25, 25, 25, -300, 25, 25]))
    np.testing.assert_array_equal(np.isnan(recording.voltage_v), [False, False, True, True, False, False])
    np.testing.assert_array_equal(recording.temperature_degc, 25.0)
    assert any("2 rows have a voltage_v outside" in note for note in recording.notes)
    assert any("1 rows have a temperature outside" in note for note in recording.notes)


@pytest.mark.parametrize(
    ("changes", "warning"),
    [
        ({"temperature_degc": np.full(6, 77.0)}, "Fahrenheit"),
        ({"soc": np.full(6, 1.2)}, "soc goes up to 1.2"),
        ({"current_a": np.zeros(6)}, "zero in every row"),
        ({"time_s": np.arange(6) / 600.0}, r"time_s=COLUMN\*60"),
    ],
)
def test_what_can_hardly_be_meant_is_warned_of(changes, warning):
    notes = [note for note in clean("a", columns(**changes)).notes if note.startswith("warning: ")]
    assert len(notes) == 1
    assert re.search(warning, notes[0])


def test_a_spike_of_the_current_is_left_out_and_raises_no_uncertainty_of_the_sign():
    n = 40
    current = np.where(np.arange(n) % 10 < 5, 2.0, 0.0)
    recording = clean("a", columns(time_s=np.arange(n), current_a=current, voltage_v=4.0 - 0.03 * current))
    spiked = current.copy()
    spiked[7] = 1e9
    uncertaintyed = clean(
        "a", columns(time_s=np.arange(n), current_a=spiked, voltage_v=4.0 - 0.03 * current + spiked * 1e-12)
    )
    assert recording.notes == ()
    assert uncertaintyed.notes == ("1 rows with a current of up to 1e+09 A, a spike, left out",)
    np.testing.assert_array_equal(uncertaintyed.current_a, np.delete(current, 7))


def test_a_short_pulse_after_a_long_rest_is_no_spike():
    current = np.zeros(400)
    current[300:302] = 5.0
    pulse = clean("a", columns(time_s=np.arange(400), current_a=current, voltage_v=4.0 - 0.03 * current))
    np.testing.assert_array_equal(pulse.current_a, current)


def test_rows_beyond_what_the_cell_can_give_are_left_out_aloud():
    current = np.where(np.arange(40) % 10 < 5, 2.0, 0.0)
    current[[7, 17, 27, 37]] = 500.0
    run = clean("a", columns(time_s=np.arange(40), current_a=current, voltage_v=4.0 - 1e-3 * current))
    kept = believable(run, 3.0)
    assert kept.current_a.max() == 2.0
    assert any("4 rows with a current beyond 180 A" in note for note in kept.notes)


def test_more_charge_than_the_cell_holds_is_uncertaintyed_and_much_more_refused():
    n = 100
    run = clean("x", columns(time_s=60.0 * np.arange(n), current_a=np.full(n, 3.0), voltage_v=np.full(n, 3.7)))
    assert believable(run, 4.0).notes == run.notes
    assert any("4.95 Ah flow one way" in note for note in believable(run, 3.0).notes)
    with pytest.raises(DatasetError, match=r"x: 4\.95 Ah flow one way, the cell holds 0\.5 Ah"):
        believable(run, 0.5)


def test_charge_in_a_gap_was_not_seen():
    time_s = np.concatenate((np.arange(10.0), 3600.0 + np.arange(10.0)))
    run = clean("x", columns(time_s=time_s, current_a=np.full(20, 3.0), voltage_v=np.full(20, 3.7)))
    assert run.seen_charge_ah[-1] == pytest.approx(18.0 * 3.0 / 3600.0)
    assert run.charge_ah[-1] == pytest.approx(3609.0 * 3.0 / 3600.0)
