import numpy as np
import pytest

from app.estimation.errors import ModelError
from app.estimation.identification.branches import REST_S, stretches
from app.estimation.identification.parts import (
    LOADED_SIGMA_V,
    REST_SIGMA_V,
    SHORT_REST_SIGMA_V,
    capacity_from_column,
    capacity_from_rests,
    charge_ah,
    choose_capacity,
    current_between,
    find_anchors,
    has_soc_column,
    reference_soc,
    typical_resistance,
)
from app.estimation.identification.slow_tests import SlowCurves
from app.estimation.recording.cell_recording import Recording

CAPACITY_AH = 3.0
OHM = 0.02
GRID = np.linspace(0.0, 1.0, 101)
SLOW = SlowCurves(GRID, 3.0 + GRID, 3.0 + GRID, CAPACITY_AH, 0.1, False)


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


def pulse_test(n=8, rest_s=REST_S + 20.0, capacity_ah=CAPACITY_AH, counts=1.0, soc_column=False):
    """Tenths of the charge at 3 A, a rest after each; the voltage is that of SLOW less OHM times the current.

    `counts` is what the rig's counter makes of an ampere hour.
    """
    pulse_s = 0.1 * capacity_ah / 3.0 * 3600.0
    parts = [np.zeros(2)] + [np.repeat([3.0, 0.0], [round(pulse_s / 10), round(rest_s / 10)]) for _ in range(n)]
    current = np.concatenate(parts)
    time_s = 10.0 * np.arange(current.size)
    before = np.concatenate((current[:1], current[:-1]))
    soc = 1.0 - np.cumsum(0.5 * (before + current) * np.diff(time_s, prepend=0.0)) / 3600.0 / capacity_ah
    volts = 3.0 + soc - OHM * current
    column = soc if soc_column else np.full(soc.size, np.nan)
    return Recording("pulses", time_s, counts * current, volts, np.full(soc.size, 25.0), column, ()), soc


def anchors(recording):
    return find_anchors(recording, np.arange(recording.time_s.size), CAPACITY_AH, OHM)


def test_a_pulse_test_tells_its_ocv_at_the_start_and_at_the_end_of_each_rest():
    recording, soc = pulse_test()
    found = anchors(recording)
    assert found.rows.size == 1 + 8
    np.testing.assert_allclose(found.ocv_v, 3.0 + soc[found.rows], atol=1e-12)
    assert (found.sigma_v == REST_SIGMA_V).all()
    assert (recording.current_a[found.rows] == 0.0).all()


def test_a_short_rest_tells_less_and_a_shorter_one_nothing():
    assert (anchors(pulse_test(rest_s=120.0)[0]).sigma_v[1:] == SHORT_REST_SIGMA_V).all()
    assert anchors(pulse_test(rest_s=40.0)[0]).rows.tolist() == [1], "the rest before the record alone"


def test_a_record_that_begins_under_load_begins_with_its_drop_given_back():
    recording, soc = pulse_test()
    later = Recording(*(each[10:] if isinstance(each, np.ndarray) else each for each in vars(recording).values()))
    first = anchors(later)
    assert first.rows[0] == 0
    assert first.ocv_v[0] == pytest.approx(3.0 + soc[10])
    assert first.sigma_v[0] == LOADED_SIGMA_V


def test_a_rest_without_a_voltage_tells_nothing():
    recording, _ = pulse_test()
    recording.voltage_v[recording.current_a == 0.0] = np.nan
    assert anchors(recording).rows.size == 0


@pytest.mark.parametrize("capacity_ah", [2.4, 3.0, 3.3])
def test_rests_tell_the_capacity_of_the_cell_that_was_pulsed(capacity_ah):
    recording, _ = pulse_test(capacity_ah=capacity_ah)
    found, sigma_ah = capacity_from_rests([recording], SLOW, OHM)
    assert found == pytest.approx(capacity_ah, rel=1e-3)
    assert 0.0 < sigma_ah < 0.1


def test_a_drive_over_a_few_percent_tells_no_capacity():
    assert capacity_from_rests([pulse_test(n=1)[0]], SLOW, OHM) is None


@pytest.mark.parametrize("counts", [0.1, 1000.0, -1.0, 10.0])
def test_a_count_that_cannot_be_of_the_slow_tests_cell_is_refused(counts):
    """Another unit, the other sign, ten cells in parallel or a tenth of one."""
    with pytest.raises(ModelError, match="another unit, clock, sign or cell") as caught:
        capacity_from_rests([pulse_test(counts=counts)[0]], SLOW, OHM)
    assert caught.value.field == "pulses"


def test_the_soc_column_holds_against_the_slow_test_and_rests_where_they_refute_it():
    notes = []
    assert choose_capacity(SLOW, [pulse_test(capacity_ah=2.4, soc_column=True)[0]], OHM, notes) == pytest.approx(2.4)
    assert choose_capacity(SLOW, [pulse_test(capacity_ah=2.4)[0]], OHM, notes) == pytest.approx(2.4, rel=1e-3)
    assert len(notes) == 2
    assert all("those hold" in note for note in notes)


def test_the_slow_tests_count_holds_where_nothing_refutes_it():
    notes = []
    assert choose_capacity(SLOW, [pulse_test()[0]], OHM, notes) == CAPACITY_AH
    assert choose_capacity(SLOW, [pulse_test(n=1)[0]], OHM, notes) == CAPACITY_AH
    assert notes == []


def test_the_soc_of_a_test_without_a_column_is_counted_from_its_rests():
    recording, soc = pulse_test()
    notes = []
    np.testing.assert_allclose(reference_soc(recording, CAPACITY_AH, SLOW, OHM, notes), soc, atol=1e-3)
    assert any("counted from its rests" in note for note in notes)
    assert not has_soc_column(recording)


def test_a_soc_column_is_taken_as_it_is():
    recording, soc = pulse_test(soc_column=True)
    notes = []
    np.testing.assert_array_equal(reference_soc(recording, CAPACITY_AH, SLOW, OHM, notes), soc)
    assert notes == []
    assert has_soc_column(recording)


def test_a_test_that_never_rests_and_says_no_soc_cannot_be_placed():
    recording, _ = pulse_test(rest_s=40.0)
    recording.voltage_v[:3] = np.nan
    with pytest.raises(ModelError, match="never rests"):
        reference_soc(recording, CAPACITY_AH, SLOW, OHM, [])
