"""The current as the master measures it: `ts` samples of 1 kHz are one mean; all that is made of it goes by that."""

import ctypes
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_protocol.config_image import default_image
from firmware_protocol.memory_map import FIELDS
from firmware_protocol.messages import Write
from simulator.accumulator import AccumulatorParameters
from simulator.loads import ConstantCurrent
from simulator.simulation import Simulation
from tests.c_measuring import Passes
from tests.c_programs import slaves_library
from tests.c_slaves import load
from tests.master_memory import Config


@pytest.fixture(scope="module")
def library() -> ctypes.CDLL:
    return load(slaves_library("-fsanitize=undefined", "-fno-sanitize-recover=all"))


class Means:
    """The means that passes of any length complete, of a current's converter whose count is a tenth of 10 mA."""

    def __init__(self, library: ctypes.CDLL, **values: int) -> None:
        config = replace(Config.from_image(default_image()), i_offset=0, i_gain=500, **values)
        self.passes = Passes(library, config)

    def take(self, counts: np.ndarray, **values: int) -> list[int]:
        """Give samples; return the means of the buffers that they filled, oldest first."""
        if values:
            self.passes.use(replace(Config.from_image(self.passes.memory.image), **values))
        self.passes.run(len(counts), counts)
        return self.passes.means

    def average(self) -> int:
        """Return the average of the newest."""
        return FIELDS["i_fc"].unpack(self.passes.memory.image)[0]


@given(st.integers(1, 200), st.lists(st.integers(1, 60), min_size=1, max_size=40), st.integers(0, 2**32 - 1))
def test_however_the_samples_come_each_counts_in_one_mean(library, ts, lengths, seed):
    counts = np.random.default_rng(seed).integers(0, 4096, sum(lengths)).astype(float)
    means, found, at = Means(library, ts=ts), [], 0
    for n in lengths:
        found += means.take(counts[at : at + n])
        at += n
    whole = len(counts) // ts
    assert found == np.rint(counts[: whole * ts].reshape(whole, ts).mean(axis=1)).tolist()


@pytest.mark.parametrize(
    ("n_samples", "newest"),
    [(0, [40]), (1, [40]), (10, [40]), (11, [30, 40]), (30, [20, 30, 40]), (1000, [10, 20, 30, 40])],
)
def test_a_longer_average_is_of_whole_buffers(library, n_samples, newest):
    means = Means(library, ts=10, fc_avg=n_samples)
    means.take(np.repeat([10.0, 20.0, 30.0, 40.0], 10))
    assert means.average() == round(np.mean(newest))


def test_a_shorter_buffer_ends_the_one_under_way(library):
    means = Means(library, ts=200)
    assert means.take(np.full(150, 7.0)) == []
    assert means.take(np.full(101, 7.0), ts=100) == [7, 7]


def changes(host, name, seconds):
    """Milliseconds at which a field of the struct got another value, in passes of 20 ms."""
    field, seen, last = FIELDS[name], [], None
    for tick in range(round(seconds / 0.02)):
        host.run(0.02)
        value = field.unpack(host.simulation.master.image)[0]
        if value != last:
            seen.append(20 * tick)
        last = value
    return seen[1:]


@pytest.mark.parametrize(("ts", "pace_ms"), [(100, 100), (200, 200), (40, 40)])
def test_current_and_charge_move_at_the_pace_of_the_buffer(host, ts, pace_ms):
    host.ask(Write(0, host.config(ts=ts)))
    host.simulation.set_load(ConstantCurrent(50.0))
    host.run(2.0)
    for name in ("i_fs", "dod"):
        assert set(np.diff(changes(host, name, 4.0)) % pace_ms) == {0}, name


def test_the_charge_is_the_sum_of_the_means(host):
    host.simulation.set_load(ConstantCurrent(100.0))
    host.run(2.0)
    memory = host.memory
    before = FIELDS["dod"].unpack(memory.image)[0]
    host.run(36.0)
    drawn_uah = FIELDS["dod"].unpack(memory.image)[0] - before
    assert drawn_uah == pytest.approx(1e6, rel=0.02)  # 36 s of 100 A are 1 Ah; the sensor's gain is 1 % off at most


def test_i_fs_is_quieter_than_a_sample(host):
    def spread(ts):
        host.ask(Write(0, host.config(ts=ts)))
        found = []
        for _ in range(60):
            host.run(0.2)
            found.append(FIELDS["i_fs"].unpack(host.simulation.master.image)[0])
        return np.std(found)

    assert spread(100) < 0.3 * spread(1)


@pytest.mark.parametrize("pass_s", [0.02, 1.0, 2.0])
def test_long_passes_of_a_simulation_lose_no_charge(pass_s):
    simulation = Simulation(AccumulatorParameters(), seed=3, step_s=pass_s)
    simulation.set_load(ConstantCurrent(100.0))
    simulation.run_until(48.0)
    before, drawn_ah = dod_of(simulation), simulation.accumulator.soc.mean()
    simulation.run_until(96.0)
    drawn_ah = (drawn_ah - simulation.accumulator.soc.mean()) * simulation.accumulator.capacity_ah.mean()
    assert drawn_ah > 1.0
    assert (dod_of(simulation) - before) * 1e-6 == pytest.approx(drawn_ah, rel=0.05)


def dod_of(simulation):
    return FIELDS["dod"].unpack(simulation.master.image)[0]
