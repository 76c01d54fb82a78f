import numpy as np
import pytest

from app.estimation.errors import ModelError
from app.estimation.identification.branches import stretches
from app.estimation.identification.parts import capacity_from_column, charge_ah, current_between, typical_resistance
from app.estimation.recording.cell_recording import Recording

CAPACITY_AH = 3.0


def discharge(current_a, dt_s=1.0, start_soc=1.0, voltage_v=None, gap_at=None, gap_s=3600.0):
    """A recording whose soc column is exact; a gap hides the charge that its rows say flowed in it."""
    current = np.asarray(current_a, dtype=np.float64)
    steps = np.full(current.size, dt_s)
    steps[0] = 0.0
    if gap_at is not None:
        steps[gap_at] = gap_s
    moved = np.concatenate(([0.0], np.cumsum(0.5 * (current[1:] + current[:-1]) * steps[1:]))) / 3600.0
    volts = np.full(current.size, 3.7) if voltage_v is None else voltage_v
    degc = np.full(current.size, 25.0)
    return Recording("test", np.cumsum(steps), current, volts, degc, start_soc - moved / CAPACITY_AH, ())


def test_a_gap_under_load_parts_a_recording_and_a_short_rest_without_rows_does_not():
    loaded = discharge(np.full(100, 2.0), gap_at=50)
    assert [rows.size for rows in stretches(loaded)] == [50, 50]
    rested = discharge(np.concatenate((np.full(50, 2.0), np.zeros(50))), gap_at=75, gap_s=300.0)
    assert [rows.size for rows in stretches(rested)] == [100]


def test_charge_is_trapezoidal_from_the_first_row():
    recording = discharge([0.0, 3.6, 3.6, 0.0], dt_s=1000.0)
    assert charge_ah(recording, np.arange(4)) == pytest.approx([0.0, 0.5, 1.5, 2.0])


def test_many_short_stretches_with_a_soc_column_tell_the_capacity_together():
    tenth = np.full(361, 1.2)
    short = [discharge(tenth, start_soc=1.0 - 0.1 * k) for k in range(6)]
    assert capacity_from_column(short) == pytest.approx(CAPACITY_AH, rel=1e-6)
    assert capacity_from_column(short[:2]) is None


def test_between_load_and_a_rest_logged_rarely_nothing_flows():
    """A rig that logs a row where a step ends, then one every five minutes."""
    time_s = np.array([0.0, 60.0, 120.0, 150.0, 450.0, 750.0])
    flows = current_between(time_s, np.array([2.0, 2.0, 2.0, 2.0, 0.0, 0.0]))
    np.testing.assert_array_equal(flows, [2.0, 2.0, 2.0, 2.0, 0.0, 0.0])
    regular = current_between(300.0 * np.arange(4), np.array([2.0, 2.0, 0.0, 0.0]))
    np.testing.assert_array_equal(regular, [2.0, 2.0, 1.0, 0.0])


def test_pulses_whose_end_fell_between_rows_do_not_outvote_a_plain_stretch():
    """Rows every 0.1 s under load and every 10 s at rest: the trapezium counts 5 s of load that never flowed."""
    pulse = discharge(np.repeat([0.0, 9.0], [2, 400]), dt_s=0.1)
    after = Recording(
        "test",
        np.append(pulse.time_s, pulse.time_s[-1] + 10.0 * np.arange(1, 9)),
        np.append(pulse.current_a, np.zeros(8)),
        np.full(410, 3.7),
        np.full(410, 25.0),
        np.append(pulse.soc, np.full(8, pulse.soc[-1])),
        (),
    )
    plain = [discharge(np.full(361, 1.2), start_soc=1.0 - 0.1 * k) for k in range(2)]
    assert charge_ah(after, np.arange(410))[-1] > 1.1 * CAPACITY_AH * (after.soc[0] - after.soc[-1])
    assert capacity_from_column([after] * 4 + plain) == pytest.approx(CAPACITY_AH, rel=1e-4)


def test_no_soc_column_tells_no_capacity():
    recording = discharge(np.full(1000, 3.0))
    recording.soc[:] = np.nan
    assert capacity_from_column([recording]) is None


def test_the_resistance_comes_from_the_steps_and_a_wrong_sign_is_named():
    current = np.tile(np.repeat([0.0, 3.0], 20), 5)
    assert typical_resistance([discharge(current, voltage_v=3.7 - 0.02 * current)]) == pytest.approx(0.02)
    with pytest.raises(ModelError, match="charge-positive"):
        typical_resistance([discharge(current, voltage_v=3.7 + 0.02 * current)])
    with pytest.raises(ModelError, match="never steps"):
        typical_resistance([discharge(np.full(50, 2.0))])
