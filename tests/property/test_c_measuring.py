"""The C master's pass of measuring on slaves that anything befalls: what stands in the struct afterwards."""

import ctypes
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_protocol.config_image import default_image
from firmware_protocol.ltc6804 import AdcMode
from firmware_protocol.memory_map import CONFIG, FIELDS, T_MISSING
from simulator import sensors
from simulator.slave import THESIS_SENSOR_INPUTS as INPUTS
from tests.c_master import NONE
from tests.c_measuring import CMeasuring, Passes
from tests.c_programs import C_FOLDER, slaves_library
from tests.c_slaves import PACKETS, DamagedChain, load
from tests.campaign import examples
from tests.ltc6804_packets import adcv
from tests.master_memory import Config
from tests.property.test_c_slaves import CELLS, EVENTS, befall

DEFAULT = Config.from_image(default_image())
REFRESH_MS = 1000
UNDEFINED = ("-fsanitize=undefined", "-fno-sanitize-recover=all")
PASSES_MS = st.sampled_from((20, 20, 20, 20, 100, 250))
REST = np.full(20, 2049.0)


@pytest.fixture(scope="module")
def library() -> ctypes.CDLL:
    return load(slaves_library(*UNDEFINED))


def in_range(name):
    return st.integers(CONFIG[name].minimum, CONFIG[name].maximum)


CONFIGS = st.fixed_dictionaries(
    {
        name: in_range(name)
        for name in ("ts", "fc_avg", "v_alpha", "i_offset", "i_gain", "c_avg", "r_fs_avg", "r_fc_avg")
    }
).map(lambda values: replace(DEFAULT, **values))
ALL_CELLS = st.sampled_from((0.0, 5.7, 6.5535)) | st.floats(2.4, 4.3)
STEPS = st.lists(
    st.tuples(
        st.lists(EVENTS, max_size=2) | st.tuples(st.tuples(st.just("all"), st.just(0), ALL_CELLS)),
        st.frozensets(st.sampled_from(PACKETS), max_size=4),
        st.sampled_from((0, 1, 2048, 2049, 2050, 3315, 3316, 3320, 3324, 3325, 4094, 4095)) | st.integers(0, 4095),
        st.booleans(),  # noise of the current
        st.none() | st.none() | st.none() | CONFIGS,
        st.none() | st.none() | st.frozensets(CELLS, max_size=6),  # cells to bleed
        PASSES_MS,
        st.integers(1, 6),  # so many passes
    ),
    min_size=1,
    max_size=10,
)


@settings(max_examples=examples(100), deadline=None)
@given(
    steps=STEPS,
    config=st.just(DEFAULT) | CONFIGS,
    inputs=st.sampled_from((INPUTS, tuple(range(12)))),
    seed=st.integers(0, 1 << 32),
    start_ms=st.sampled_from((0, 0xFFFFFF00)),
)
def test_the_struct_says_what_the_slaves_and_the_converter_gave(library, steps, config, inputs, seed, start_ms):
    passes, rng = Passes(library, config, inputs, start_ms), np.random.default_rng(seed)
    chain, memory = passes.chain, passes.memory
    for events, damaged, count, is_noisy, new_config, bled, pass_ms, n_passes in steps:
        chain.damaged = damaged
        for event in events:
            befall_any(chain, *event)
        if new_config is not None:
            passes.use(config := new_config)
        if bled is not None:
            passes.bleed(np.isin(np.arange(96), [*bled]))
        for _ in range(n_passes):
            noise = rng.integers(-3, 4, pass_ms) if is_noisy else np.zeros(pass_ms)
            counts = np.clip(count + noise, 0, 4095).astype(np.float64)
            reading = passes.run(pass_ms, counts)
            check_voltages(memory, reading, np.flatnonzero(passes.c.known()))
            check_temperatures(memory)
            assert value(passes, "n_slaves") + np.count_nonzero(~chain.is_powered) <= 8
    lowest, highest = (amperes_raw(config, count) for count in (0, 4095))
    assert all(min(lowest, highest) <= mean <= max(lowest, highest) for mean in passes.means)


def amperes_raw(config, count):
    return round((10 * count - config.i_offset) * config.i_gain / 5000)


def check_voltages(memory, reading, known):
    """Minimum, maximum, mean and sum are those of the cells that have a voltage; the others show none."""
    v, of = memory.v.astype(int), lambda name: FIELDS[name].unpack(memory.image)[0]
    assert not np.delete(v, known).any()
    assert (of("v_min"), of("v_max")) == ((v[known].min(), v.max()) if len(known) else (0, 0))
    assert of("v_avg") == (round(v.sum() / len(known)) if len(known) else 0)
    assert of("v_tot") == min(round(v.sum() / 100), 0xFFFF)
    if len(known):
        assert (reading.v_min_id, reading.v_max_id) == (known[v[known].argmin()], v.argmax())


def check_temperatures(memory):
    """Minimum, maximum and mean are those of the cells that have a temperature."""
    t, of = memory.t.astype(int), lambda name: FIELDS[name].unpack(memory.image)[0]
    known = t[t != T_MISSING]
    expected = (known.min(), known.max(), round(known.mean())) if len(known) else (T_MISSING,) * 3
    assert (of("t_min"), of("t_max"), of("t_avg")) == expected


def befall_any(chain, kind, where, how):
    if kind == "all":
        chain.converters.cell_v = how + 0.001 * np.sin(np.arange(96))
    else:
        befall(chain, kind, where, how)


# --- what an operator has to see


def test_a_minute_of_faults_that_come_and_go(library):
    passes = Passes(library, DEFAULT)
    chain = passes.chain

    def after(n, count=2049.0):
        for _ in range(n):
            reading = passes.run(20, np.full(20, count))
        return reading

    reading = after(60)
    assert (reading.v_min, reading.v_min_id, reading.v_max, reading.v_max_id) == (30_000, 0, 39_500, 95)
    assert (reading.lost_cell, reading.lost_slave, reading.lost_temperature) == (NONE, NONE, NONE)
    assert value(passes, "v_avg") == 34_750
    assert value(passes, "v_tot") == 33_360
    assert value(passes, "n_slaves") == 8
    chain.converters.open_wires.add(40)
    reading = after(60)
    assert reading.lost_cell == 40
    assert np.flatnonzero(passes.memory.v == 0).tolist() == [40, 41]
    assert value(passes, "v_avg") == round((34_750 * 96 - 34_000 - 34_100) / 94)
    chain.converters.open_wires.clear()
    chain.set_powered(0, False)
    reading = after(60)
    assert (reading.lost_slave, reading.lost_cell, reading.v_min_id) == (0, NONE, 12)
    assert passes.memory.t[:12].tolist() == [T_MISSING] * 12
    assert value(passes, "n_slaves") == 7
    chain.set_powered(0, True)
    assert after(60).lost_slave == NONE
    for pack in range(8):
        chain.set_powered(pack, False)
    reading = after(20)
    assert (reading.v_min, reading.v_max, reading.t_min, reading.t_max) == (0xFFFF, 0, 127, -128)
    assert [value(passes, name) for name in ("v_min", "v_avg", "v_tot", "t_min", "t_avg")] == [0, 0, 0, -128, -128]


def value(passes, name):
    return FIELDS[name].unpack(passes.memory.image)[0]


def test_a_cell_that_is_measured_again_begins_with_what_it_is(library):
    passes = Passes(library, replace(DEFAULT, v_alpha=1))
    for _ in range(5):
        passes.run(20, REST)
    for is_on, volts in ((False, 3.0), (True, 3.9)):
        passes.chain.set_powered(2, is_on)
        passes.chain.converters.cell_v = np.full(96, volts)
        for _ in range(5):
            passes.run(20, REST)
    assert passes.memory.v[24:36].tolist() == [39_000] * 12
    assert passes.memory.v[36] < 33_700  # the others have hardly moved


def test_the_mean_of_the_current_and_its_average(library):
    """Ten means of two samples: 0 A, then one of 10 counts more, of which a fifth is seen."""
    passes = Passes(library, replace(DEFAULT, ts=2, fc_avg=10))
    passes.run(20, REST)
    passes.run(20, np.where(np.arange(20) < 18, 2049.0, 2059.0))
    assert [value(passes, name) for name in ("i_fs", "i_fc")] == [242, 48]  # 0.2424 A a count


@pytest.mark.parametrize(
    ("count", "is_lost"),
    [(0, True), (1, False), (3315, False), (3316, True), (3324, True), (3325, False), (4094, False), (4095, True)],
)
def test_a_converter_at_its_ends_or_an_open_input_is_no_current(library, count, is_lost):
    passes = Passes(library, DEFAULT)
    assert passes.run(20, np.full(20, float(count))).lost_current == is_lost


def test_the_open_input_is_that_of_the_simulated_sensor():
    header = (C_FOLDER / "master" / "vw_measuring.h").read_text(encoding="utf-8")
    numbers = {"TOP": sensors.ADC_MAX, "OPEN": sensors.UNPLUGGED_COUNT, "OPEN_WIDTH": sensors.UNPLUGGED_WIDTH}
    for name, number in numbers.items():
        assert f"#define VW_MEASURING_{name} {number}u" in header


def test_a_pass_without_a_sample_has_lost_the_sensor_and_holds_the_average(library):
    c = CMeasuring(library, DamagedChain(INPUTS), replace(DEFAULT, ts=20))
    c.samples(np.full(20, 2149.0))
    reading, means, _ = c.run(0.02, 20)
    assert (reading.lost_current, means, reading.i_fc) == (False, [2424], 2424)
    reading, means, _ = c.run(0.04, 20)
    assert (reading.lost_current, means, reading.i_fc) == (True, [], 2424)


def test_no_sample_is_lost_where_there_are_more_means_than_a_pass_takes(library):
    c = CMeasuring(library, DamagedChain(INPUTS), replace(DEFAULT, ts=1))
    counts = 2049.0 + np.arange(300)
    assert c.samples(counts) == 255
    assert len(c.run(0.3, 300)[1]) == 255
    assert c.samples(counts[255:]) == 45
    assert c.run(0.6, 300)[1] == [round(2.424 * 100 * k / 10) for k in range(255, 300)]


def test_switches_are_written_every_second_and_when_they_are_new(library):
    c = CMeasuring(library, DamagedChain(INPUTS), DEFAULT, 0xFFFFFFF0)
    cells = np.arange(96) == 13
    written = [at_ms for at_ms in range(20, 3000, 20) if c.bleed(cells, at_ms / 1000, is_now=at_ms == 500)]
    assert written == [20, 500, 500 + REFRESH_MS, 500 + 2 * REFRESH_MS]
    assert np.flatnonzero(c.reader.chain.discharging).tolist() == [13]


def test_what_the_estimator_writes_is_left_alone(library):
    """Its flag is the byte behind the two pointers."""
    c = CMeasuring(library, DamagedChain(INPUTS), DEFAULT)
    c._state[2 * ctypes.sizeof(ctypes.c_void_p)] = 1
    c.memory.ocv[:] = 36_123
    for k in range(1, 100):
        c.samples(REST)
        c.run(0.02 * k, 20)
    assert set(c.memory.ocv.tolist()) == {36_123}
    assert set(c.memory.c.tolist()) == {DEFAULT.c_avg}


def test_a_slave_that_is_lost_within_a_pass_keeps_the_voltages_that_it_gave(library):
    """Its voltages arrive, its temperatures and self-tests do not: the next pass is the first without it."""
    passes = Passes(library, DEFAULT)
    chain = passes.chain
    for _ in range(2):
        passes.run(250, np.full(250, 2049.0))
    lose_after_the_voltages(chain, 3)
    reading = passes.run(250, np.full(250, 2049.0))
    assert (reading.lost_slave, reading.lost_cell) == (NONE, NONE)
    assert passes.memory.v[36:48].all()
    assert chain.damaged
    reading = passes.run(250, np.full(250, 2049.0))
    assert reading.lost_slave == 3
    assert not passes.memory.v[36:48].any()


def lose_after_the_voltages(chain, slave):
    """Damage a slave's packets from the first conversion with the sensors switched in."""
    execute = chain.execute

    def watched(packet, now_s):
        if int.from_bytes(packet[:2], "big") == adcv(AdcMode.FAST, discharge_permitted=True):
            chain.damaged = frozenset((0, slave, at) for at in range(4))
        return execute(packet, now_s)

    chain.execute = watched
