import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.errors import EstimatorError, ShapeError
from app.estimation.health.cell_finding import SURE
from app.estimation.health.cell_watch import JUDGE_S, CellWatch
from tests.campaign import of_size

N, PER_PACK, DT_S = 96, 12, 0.1
STANDING_S = 0.5  # time of a sample while nothing changes
PAIR_OHM = 1e-3
WARM = np.full(N, 30.0)


class Car:
    """Cells of a flat OCV with one RC pair, and the clock of the watch that sees them."""

    def __init__(self, watch, seed=5):
        self.watch, self.rng = watch, np.random.default_rng(seed)
        self.resistance_ohm = 2e-3 + self.rng.normal(0, 2e-5, N)
        self.time_s = self.pair_a = 0.0

    def drive(self, seconds, currents_a=(-60.0, 0.0, 20.0, 120.0, 200.0)):
        current_a = 0.0
        for k in range(round(seconds / DT_S)):
            if k % 12 == 0:
                current_a = self.rng.choice(currents_a)
            self._sample(current_a)

    def stand(self, seconds):
        for _ in range(round(seconds / STANDING_S)):
            self._sample(0.0, STANDING_S)

    def _sample(self, current_a, dt_s=DT_S):
        self.time_s += dt_s
        self.pair_a += dt_s / 10.0 * (current_a - self.pair_a)
        noise_v = self.rng.normal(0, 1e-3, N)
        voltages_v = 3.7 - self.resistance_ohm * current_a - PAIR_OHM * self.pair_a + noise_v
        self.watch.step(self.time_s, dt_s, current_a + self.rng.normal(0, 0.2), voltages_v, WARM)
        if self.time_s % JUDGE_S < dt_s:
            self.watch.judge()


@pytest.fixture
def cell():
    return load_cell()


def new_watch(cell, memory=None):
    return CellWatch(cell, (PER_PACK,) * (N // PER_PACK), memory)


def joints(watch):
    return {each.cell: each for each in watch.findings if each.code == "joint-resistance-high"}


def test_a_grown_joint_is_a_finding_with_its_size_and_evidence(cell):
    car = Car(new_watch(cell))
    car.drive(100)
    assert car.watch.findings == ()
    before_s = car.time_s
    car.resistance_ohm[63] += 14e-3
    car.drive(60)
    found = joints(car.watch)
    assert list(found) == [63]
    low, high = found[63].band
    assert low <= 14e-3 <= high
    assert found[63].since_s >= before_s
    assert found[63].current_a > 30.0
    assert found[63].confidence > 0.95


@settings(max_examples=of_size(1, 6, 40), deadline=None)
@given(st.floats(30.0, 90.0), st.floats(3e-3, 14e-3))
@example(36.0, 5e-3)  # a few judgements are known of its past
def test_a_joint_that_parts_at_any_time_is_neither_a_leak_nor_the_cell(sound_s, more_ohm):
    car = Car(new_watch(load_cell()))
    car.drive(sound_s)
    car.resistance_ohm[63] += more_ohm
    for _ in range(6):
        car.drive(15)
        assert {(each.code, each.cell) for each in car.watch.findings} <= {("joint-resistance-high", 63)}
    assert joints(car.watch)[63].size == pytest.approx(more_ohm, rel=0.1)


def test_a_finding_stands_still_while_the_car_does(cell):
    car = Car(new_watch(cell))
    car.drive(60)
    car.resistance_ohm[63] += 14e-3
    car.drive(60)
    before = joints(car.watch)[63]
    car.stand(300)
    after = joints(car.watch)[63]
    assert after.size == pytest.approx(before.size, rel=0.05)
    assert after.seen_s == pytest.approx(before.seen_s, abs=10.0)
    assert car.watch.resistance_age_s > 280


def test_a_finding_survives_a_restart_until_driving_shows_a_sound_joint(cell):
    car = Car(new_watch(cell))
    car.drive(60)
    car.resistance_ohm[63] += 14e-3
    car.drive(60)
    before = joints(car.watch)[63]
    car.watch = new_watch(cell, car.watch.memory)
    car.stand(60)
    assert joints(car.watch) == {63: before}
    car.resistance_ohm[63] -= 14e-3
    car.drive(90)
    assert car.watch.findings == ()


def test_a_missing_voltage_is_no_evidence_of_a_sound_joint(cell):
    car = Car(new_watch(cell))
    car.resistance_ohm[63] += 14e-3
    car.drive(100)
    assert list(joints(car.watch)) == [63]
    car.resistance_ohm[63] = np.nan
    car.drive(100)
    assert list(joints(car.watch)) == [63]


class Pack:
    """Cells by the OCV of the cell file, plain resistances, capacities, leaks and temperatures; sensors that fail."""

    def __init__(self, cell, n_cells=24, per_pack=12, seed=1):
        self.cell, self.n, self.per_pack, self.rng = cell, n_cells, per_pack, np.random.default_rng(seed)
        self.soc = 0.8 + 0.003 * self.rng.normal(size=n_cells)
        self.capacity_ah = cell.capacity_ah * (1 + 0.005 * self.rng.normal(size=n_cells))
        self.leak_a, self.ohm = np.zeros(n_cells), 3e-3 + self.rng.normal(0, 3e-5, n_cells)
        self.shown_v, self.shown_degc = {}, {}  # what failed sensors show instead
        self.time_s, self.degc = 1.7e9, 25.0
        self.watch = CellWatch(cell, (per_pack,) * (n_cells // per_pack))

    def restart(self, pause_s=60.0):
        self.time_s += pause_s
        self.watch = CellWatch(self.cell, (self.per_pack,) * (self.n // self.per_pack), self.watch.memory)

    def run(self, seconds, currents_a=(0.0,), dt_s=0.4):
        """Let time pass with another current every 2 s; return what is found, as pairs of code and cell."""
        current_a = 0.0
        for k in range(round(seconds / dt_s)):
            if k % round(2.0 / dt_s) == 0:
                current_a = float(self.rng.choice(currents_a))
            self.time_s += dt_s
            self.degc += 2e-6 * current_a**2 * dt_s
            self.soc -= (current_a + self.leak_a) * dt_s / 3600 / self.capacity_ah
            v = self.cell.ocv.voltage(self.soc) - self.ohm * (current_a + self.leak_a)
            v += self.rng.normal(0, 2e-4, self.n)
            degc = np.full(self.n, np.round(self.degc))
            v[list(self.shown_v)] = list(self.shown_v.values())
            degc[list(self.shown_degc)] = list(self.shown_degc.values())
            self.watch.step(self.time_s, dt_s, current_a, v, degc)
            if k % round(2.4 / dt_s) == 0:
                self.watch.judge()
        return {(each.code, each.cell) for each in self.watch.findings}


RACING = (-40.0, 0.0, 30.0, 60.0, 120.0)
shapes = st.sampled_from([(14, 14), (24, 12), (54, 18)])
places = st.floats(0.0, 1.0, exclude_max=True)


@settings(max_examples=of_size(2, 4, 20))
@given(shapes, st.integers(0, 10**6))
def test_a_sound_pack_has_no_finding_whatever_the_noise(shape, seed):
    pack = Pack(load_cell(), *shape, seed)
    assert pack.run(90) == set()
    assert pack.run(240, RACING) == set()
    assert pack.run(120) == set()


@settings(max_examples=of_size(2, 4, 20))
@given(shapes, places, st.floats(4.0, 20.0), st.integers(0, 10**6))
def test_a_leak_is_a_finding_of_its_cell_alone_with_a_band_that_holds_it(shape, place, leak_a, seed):
    pack, cell = Pack(load_cell(), *shape, seed), int(place * shape[0])
    pack.run(90)
    pack.leak_a[cell] = leak_a
    assert pack.run(240) == {("self-discharge-high", cell)}
    (found,) = pack.watch.findings
    assert abs(found.size - leak_a) < 3 * found.sigma
    assert cell not in found.neighbours
    assert len(found.neighbours) == shape[1] - 1
    assert all(other // shape[1] == cell // shape[1] for other in found.neighbours)


@settings(max_examples=of_size(2, 4, 20))
@given(shapes, places, st.sampled_from([-40.0, 125.0, float("nan")]), st.integers(0, 10**6))
def test_a_thermistor_that_came_off_is_the_finding_and_the_cell_is_not(shape, place, shown_degc, seed):
    pack, cell = Pack(load_cell(), *shape, seed), int(place * shape[0])
    pack.run(10)
    pack.shown_degc[cell] = shown_degc
    code = "temperature-sensor-open" if np.isnan(shown_degc) else "temperature-sensor-fault"
    assert pack.run(30) == {(code, cell)}
    pack.shown_degc.clear()
    assert pack.run(40) == set()


@pytest.mark.parametrize(("shape", "stuck", "seed"), [((14, 14), 0, 1), ((24, 12), 12, 2), ((54, 18), 53, 3)])
def test_a_channel_that_is_stuck_is_neither_leak_nor_joint_nor_capacity(cell, shape, stuck, seed):
    pack = Pack(cell, *shape, seed)
    pack.run(60, RACING)
    pack.shown_v[stuck] = 3.9
    assert pack.run(120, RACING) == {("cell-voltage-stuck", stuck)}
    assert pack.run(120) == {("cell-voltage-stuck", stuck)}
    pack.shown_v.clear()
    assert pack.run(400, RACING) == set()


def test_a_leak_survives_a_restart_and_ends_when_the_cell_is_mended(cell):
    pack = Pack(cell)
    pack.run(90)
    pack.leak_a[5] = 6.0
    assert pack.run(240) == {("self-discharge-high", 5)}
    (before,) = pack.watch.findings
    pack.restart()
    assert pack.run(30) == {("self-discharge-high", 5)}
    assert pack.watch.findings[0].since_s == before.since_s
    pack.leak_a[5] = 0.0
    assert pack.run(1800, dt_s=1.0) == set()


def test_two_faults_are_two_findings(cell):
    pack = Pack(cell)
    pack.run(90)
    pack.leak_a[5], pack.shown_degc[17] = 6.0, 125.0
    assert pack.run(240) == {("self-discharge-high", 5), ("temperature-sensor-fault", 17)}
    assert all(0.0 < each.confidence <= SURE for each in pack.watch.findings)


@pytest.mark.parametrize("jump_s", [-1e5, 1e5, -1.7e9])
def test_a_clock_that_is_set_is_no_finding_and_ends_none(cell, jump_s):
    pack = Pack(cell)
    pack.run(90)
    pack.leak_a[5] = 6.0
    pack.run(240)
    pack.time_s += jump_s
    assert pack.run(120) == {("self-discharge-high", 5)}


def test_samples_without_current_voltage_or_temperature_are_no_evidence(cell):
    pack, nothing = Pack(cell), np.full(24, np.nan)
    pack.run(60, RACING)
    for k in range(300):
        pack.watch.step(pack.time_s + 0.2 * k, 0.2, float("nan"), nothing, nothing)
        pack.watch.judge()
    pack.time_s += 60.0
    assert pack.watch.findings == ()
    assert pack.run(60, RACING) == set()


@pytest.mark.parametrize("dt_s", [-0.1, float("nan"), float("inf")])
def test_a_step_of_no_length_is_refused_and_leaves_every_watch_awake(cell, dt_s):
    pack = Pack(cell)
    pack.run(10)
    with pytest.raises(EstimatorError, match="dt_s"):
        pack.watch.step(pack.time_s, dt_s, 0.0, np.full(24, 3.9), np.full(24, 25.0))
    pack.shown_degc[3] = 125.0
    assert pack.run(30) == {("temperature-sensor-fault", 3)}


@pytest.mark.parametrize("segments", [(), (12, 0), (-1,)])
def test_a_segment_without_a_cell_is_refused(cell, segments):
    with pytest.raises(ShapeError, match="packs"):
        CellWatch(cell, segments)


def test_a_memory_of_another_battery_is_refused(cell):
    with pytest.raises(ShapeError):
        CellWatch(cell, (12, 12), Pack(cell, 14, 14).watch.memory)


def test_cells_that_are_told_a_few_at_a_time_are_not_compared(cell):
    rng, n = np.random.default_rng(3), 24
    watch = CellWatch(cell, (12, 12))
    for k in range(3000):
        current_a = float((0, 80, 150, 20, -40, 110)[k // 7 % 6])
        volts = np.full(n, np.nan)
        told = 4 * (k % 6) + np.arange(4)
        volts[told] = 3.7 - 0.002 * current_a * (1 + 0.5 * (told < 4)) + rng.normal(0, 1e-3, 4)
        watch.step(0.1 * k, 0.1, current_a, volts, np.full(n, 25.0))
        if k % 100 == 0:
            watch.judge()
    assert watch.findings == ()
    assert not watch.has("joint-resistance-high").any()


@pytest.mark.parametrize("turns", [2, 3])
def test_cells_whose_messages_take_turns_are_not_called_stuck(cell, turns):
    watch, rng = new_watch(cell), np.random.default_rng(8)
    of_turn = np.arange(N) // 4 % 8 == 0  # one message of eight comes in each `turns`-th sample alone
    for k in range(400):
        current_a = 60.0 + 50.0 * np.sin(k / 9.0)
        voltages_v = 3.7 - 2e-3 * current_a + rng.normal(0, 1e-3, N)
        voltages_v[of_turn if k % turns else np.zeros(N, bool)] = np.nan
        watch.step(k * DT_S, DT_S, current_a, voltages_v, WARM)
    assert [each for each in watch.judge() if each.code == "cell-voltage-stuck"] == []


def test_cells_that_are_not_told_for_seconds_are_missing_whenever_the_channels_are_looked_at(cell):
    watch, rng = new_watch(cell), np.random.default_rng(8)
    for k in range(100):
        voltages_v = 3.7 + rng.normal(0, 1e-3, N)
        voltages_v[5] = np.nan
        watch.step(k * DT_S, DT_S, 0.0, voltages_v, WARM)
    assert {each.cell for each in watch.judge() if each.code == "cell-voltage-missing"} == {5}


FIRST = 36  # cell of the fourth pack


def sense(watch, seconds, spoil, begin_s=0.0, first_s=DT_S):
    """Drive with a healthy battery that warms; `spoil(voltages, temperatures)` takes away what is not measured."""
    rng = np.random.default_rng(4)
    for k in range(round(seconds / DT_S)):
        current_a = 60.0 + 50.0 * np.sin(k / 20)
        voltages_v, degc = 3.7 - 2e-3 * current_a + rng.normal(0, 1e-3, N), WARM.copy()
        spoil(voltages_v, degc)
        watch.step(begin_s + k * DT_S, first_s if k == 0 else DT_S, current_a, voltages_v, degc)
    return {(each.code, each.cell) for each in watch.judge()}


def open_wire(voltages_v, degc):
    voltages_v[FIRST + 6 : FIRST + 8] = np.nan
    degc[[FIRST + 3, FIRST + 9]] = np.nan  # read through its input, of other cells


def stuck_channel(voltages_v, _):
    voltages_v[FIRST] = 3.5


def no_voltage(voltages_v, _):
    voltages_v[FIRST] = np.nan


def cold_thermistor(_, degc):
    degc[FIRST] = -20.0


def no_thermistor(_, degc):
    degc[FIRST] = np.nan


def nothing_wrong(voltages_v, degc):
    pass


def test_temperatures_that_go_with_a_sense_wire_are_no_faults_of_their_sensors(cell):
    missing = {("cell-voltage-missing", FIRST + 6), ("cell-voltage-missing", FIRST + 7)}
    watch = new_watch(cell)
    sense(watch, 20, nothing_wrong)
    assert sense(watch, 60, open_wire, 20) == missing


@pytest.mark.parametrize("spoil", [stuck_channel, no_voltage, cold_thermistor, no_thermistor])
def test_neither_restart_nor_silence_ends_a_finding_of_a_sensor(cell, spoil):
    watch = new_watch(cell)
    (found,) = sense(watch, 30, spoil)
    before = watch.findings
    watch = new_watch(cell, watch.memory)
    assert repr(watch.judge()) == repr(before)  # nan is not nan
    assert sense(watch, 1, nothing_wrong, 3600, first_s=3600) == {found}  # the first sound second after an hour
    assert sense(watch, 30, nothing_wrong, 3601) == set()


def test_the_first_sample_after_silence_begins_no_finding(cell):
    watch = new_watch(cell)
    assert sense(watch, 30, nothing_wrong) == set()
    assert sense(watch, DT_S, no_thermistor, 3600, first_s=3600) == set()
