"""The C driver of the slaves on simulated slaves under faults: what it says is known, and what goes over the pair."""

import ctypes
import os
import subprocess
import sys
from ctypes import byref, c_bool, c_int, c_uint8, c_uint16, c_uint32
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_protocol import ltc6804
from firmware_protocol.ltc6804 import (
    SENSOR_FIRST_DEGC,
    SENSOR_MARGIN_V,
    SENSOR_POINTS_V,
    SENSOR_STEP_DEGC,
    AdcMode,
    Command,
    with_pec,
)
from firmware_protocol.memory_map import T_MISSING
from simulator.conversion import ADOW, AXST, CVST, STATST, SelfTest
from simulator.slave import THESIS_SENSOR_INPUTS as INPUTS
from tests.c_programs import slaves_library
from tests.c_slaves import PACKETS, CReader, DamagedChain, load, started
from tests.campaign import examples
from tests.ltc6804_packets import Configuration, StatusB, adax, adcv, adstat

HEADER = Path(__file__).parents[2] / "firmware_protocol" / "c" / "master" / "vw_slaves.h"
PASS_S = 0.1  # long enough for temperatures and all stages of the check
UNDEFINED = ("-fsanitize=undefined", "-fno-sanitize-recover=all")
ADDRESS = ("-fsanitize=address",)


@pytest.fixture(scope="module")
def library() -> ctypes.CDLL:
    return load(slaves_library(*UNDEFINED))


# --- packets

# the first is the data sheet's worked example; the others were made by its two algorithms beside each other
PEC_VECTORS = {
    "0001": 0x3D6E, "0002": 0x2B0A, "0004": 0x07C2, "0006": 0x9A94, "0008": 0x5E52, "000a": 0xC304, "000c": 0xEFCC,
    "000e": 0x729A, "0010": 0xED72, "0012": 0x7024, "0711": 0xC9C0, "0712": 0xDFA4, "0714": 0xF36C, "0360": 0xF46C,
    "0370": 0xAF42, "03e0": 0xB04A, "0560": 0xD3A0, "05e0": 0x9786, "0568": 0x3BAE, "8004": 0x77D6, "8804": 0x8428,
    "b804": 0x317A, "8001": 0x4D7A, "b80a": 0xF5BC, "000000000000": 0xC212, "ffffffffffff": 0x664C,
    "010203040506": 0x22EE, "889088908890": 0xE5B2,
}  # fmt: skip


@pytest.mark.parametrize(("data", "pec"), PEC_VECTORS.items())
def test_check_words_are_those_of_the_data_sheet(library, data, pec):
    raw = bytes.fromhex(data)
    assert library.vw_ltc_pec15(raw, ctypes.c_size_t(len(raw))) == pec


@settings(max_examples=examples(60))
@given(data=st.binary(max_size=40))
def test_check_words_of_any_bytes(library, data):
    assert library.vw_ltc_pec15(data, ctypes.c_size_t(len(data))) == ltc6804.pec15(data)


@pytest.mark.parametrize("mode", AdcMode)
def test_conversions_are_the_same_commands(library, mode):
    c = {name: getattr(library, f"vw_ltc_{name}") for name in ("adcv", "adow", "adax", "adstat")}
    m = c_int(mode)
    for is_on in (False, True):
        assert c["adcv"](m, c_bool(is_on)) == adcv(mode, discharge_permitted=is_on)
        assert c["adow"](m, c_bool(is_on)) == ADOW | mode << 7 | 0x40 * is_on
    assert (c["adax"](m), c["adstat"](m)) == (adax(mode), adstat(mode))
    for pattern in (1, 2):
        for name, kind in (("cvst", CVST), ("axst", AXST), ("statst", STATST)):
            test = SelfTest(kind, mode, pattern)
            assert getattr(library, f"vw_ltc_{name}")(m, c_uint8(pattern)) == test.command
            for option in (False, True):
                code = library.vw_ltc_self_test_code(m, c_uint8(pattern), c_bool(option))
                assert code == test.code(adc_option=option)


class CConfiguration(ctypes.Structure):
    _fields_ = (
        ("gpio_pull_down_off", c_uint8),
        ("reference_on", c_bool),
        ("timer_pin", c_bool),
        ("adc_option", c_bool),
        ("under_voltage_code", c_uint16),
        ("over_voltage_code", c_uint16),
        ("discharge", c_uint16),
        ("discharge_timer", c_uint8),
    )


@settings(max_examples=examples(60))
@given(group=st.binary(min_size=6, max_size=6))
def test_a_configuration_means_the_same_and_comes_back_byte_for_byte(library, group):
    decoded, encoded = CConfiguration(), (c_uint8 * 6)()
    library.vw_ltc_config_decode(group, byref(decoded))
    library.vw_ltc_config_encode(byref(decoded), encoded)
    meaning = Configuration.from_bytes(group)
    assert bytes(encoded) == meaning.to_bytes() == group
    assert (decoded.reference_on, decoded.timer_pin, decoded.adc_option) == (
        meaning.reference_on,
        meaning.software_timer_enabled,
        meaning.adc_option,
    )
    assert (decoded.under_voltage_code, decoded.over_voltage_code, decoded.discharge_timer) == (
        meaning.under_voltage_code,
        meaning.over_voltage_code,
        meaning.discharge_timer_code,
    )
    assert [bool(decoded.discharge >> cell & 1) for cell in range(12)] == list(meaning.discharging)
    assert [bool(decoded.gpio_pull_down_off >> at & 1) for at in range(5)] == list(meaning.gpio_pull_down_off)


# --- the set-up


def macro(name: str) -> str:
    (line,) = [line for line in HEADER.read_text().splitlines() if line.startswith(f"#define {name} ")]
    return line.removeprefix(f"#define {name} ").split("/*")[0].strip()


def test_the_set_up_is_what_the_thesis_prints():
    """B.8: its registers and its four waits; addresses and the order of temperatures as on its boards."""
    numbers = {name: int(macro(f"VW_SLAVES_{name}").rstrip("u")) for name in (
        "FIRST_ADDRESS", "WAKE_US", "CELLS_US", "SENSORS_US", "SWITCH_US"
    )}  # fmt: skip
    assert list(numbers.values()) == [1, 500, 4500, 1400, 100]
    lists = [macro(f"VW_SLAVES_{name}").strip("{ }").split(",") for name in ("CONFIG", "SENSOR_INPUTS")]
    config, inputs = ([int(item.strip().rstrip("u"), 0) for item in items] for items in lists)
    assert (bytes(config), tuple(inputs)) == (bytes.fromhex("059846a40010"), INPUTS)


def test_what_goes_over_the_bus_is_what_the_thesis_sends(library):
    chain = DamagedChain(INPUTS)
    c = CReader(library, chain)
    assert c.start(0.0) == 8
    sent = [packet.hex() for _, packet in c.log]
    assert sent[:3] == ["", "0711c9c0", "00013d6e" + with_pec(bytes.fromhex("059846a40010")).hex()]
    assert [int(packet[:2], 16) for packet in sent[3:]] == [0x80 | (slave + 1) << 3 for slave in range(8)]
    c.log.clear()
    c.begin(0.1)
    c.read_voltages()
    c.read_temperatures()
    times_us = [round(1e6 * (at_s - 0.1)) for at_s, _ in c.log]
    kinds = [packet[:2].hex() for _, packet in c.log]
    assert kinds[:3] == ["", "03e0", ""]
    assert kinds[3:7] == ["8804", "8806", "8808", "880a"]
    assert kinds[35:37] == ["0001", "02f0"]
    # from the end of one packet to the beginning of the next
    assert times_us[1] - 32 - times_us[0] == 500
    assert times_us[2] - times_us[1] == 4500
    assert times_us[36] - 32 - times_us[35] == 100
    assert times_us[37] - 32 - times_us[36] == 1400


def test_the_first_reading_has_no_voltage_because_the_reference_is_not_up(library):
    c = started(library)
    for now_s, is_known in ((0.0, False), (0.02, True)):
        c.begin(now_s)
        c.read_voltages()
        assert c.known() == [is_known] * 96


def test_the_start_names_the_slaves_that_do_not_hold_the_configuration(library):
    chain = DamagedChain(INPUTS)
    chain.set_powered(3, False)
    chain.damaged = frozenset({(2, 6, 0)})
    c = CReader(library, chain)
    assert c.start(0.0) == 6
    assert c.memory.slave_status.tolist() == [1, 1, 1, 255, 1, 1, 255, 1]
    without_pin = DamagedChain(INPUTS)
    without_pin.has_timer_pin = False  # the discharge timer does not run, so it reads as 0
    assert CReader(library, without_pin).start(0.0) == 0


def test_an_spi_that_fails_gives_no_value_and_every_slave_is_silent(library):
    c = started(library)
    c.begin(0.1)
    c.read_voltages()
    assert all(c.known())
    c.spi_works = False
    c.begin(0.12)
    assert c.read_voltages() == 8
    assert not any(c.known())
    assert set(c.temperatures_degc()) == {T_MISSING}
    assert c.memory.slave_status.tolist() == [255] * 8


def test_every_count_of_a_sensor_is_the_same_temperature(library):
    found = np.array([library.vw_slaves_sensor_degc(c_uint16(count)) for count in range(0x10000)])
    volts = np.arange(0x10000) * 1e-4
    degc = SENSOR_FIRST_DEGC + SENSOR_STEP_DEGC * np.arange(len(SENSOR_POINTS_V) - 1, -1, -1)
    exact = np.interp(volts, SENSOR_POINTS_V[::-1], degc)
    inside = (volts >= SENSOR_POINTS_V[-1] - SENSOR_MARGIN_V - 1e-9) & (
        volts <= SENSOR_POINTS_V[0] + SENSOR_MARGIN_V + 1e-9
    )
    assert np.array_equal(found != T_MISSING, inside)
    assert np.abs(found - exact)[inside].max() <= 0.5 + 1e-9


@pytest.mark.parametrize(
    ("volts", "degc"),
    [
        (1.955, 17.5),  # copies of the table that lost the 1.92 V point are 5 K wrong on one side of 20 degC
        (1.89, 22.5),
        (2.225, -4.58),  # the cold side has its sign
        (2.122, 4.0),
        (2.4449, -40.0),  # rounding at the ends is no fault
        (1.2951, 120.0),
    ],
)
def test_a_sensor_voltage_is_read_along_the_published_curve(library, volts, degc):
    assert abs(library.vw_slaves_sensor_degc(c_uint16(round(volts * 1e4))) - degc) <= 0.5 + 1e-9


def test_what_is_no_cell_has_no_value(library):
    c = started(library)
    slaves = byref(c.slaves)
    assert library.vw_slaves_valid_cells(slaves, c_uint8(8)) == 0
    assert library.vw_slaves_cell_degc(slaves, c_uint8(8), c_uint8(0)) == T_MISSING
    assert library.vw_slaves_cell_degc(slaves, c_uint8(0), c_uint8(12)) == T_MISSING


# --- readings under faults

SLAVES = st.integers(0, 7)
CELLS = st.integers(0, 95)
EVENTS = st.one_of(
    st.tuples(st.just("power"), SLAVES, st.booleans()),
    st.tuples(st.just("wire"), CELLS, st.booleans()),
    st.tuples(st.just("stick"), SLAVES, st.sampled_from((0, 0x80, 0x8001))),
    st.tuples(st.just("drift"), SLAVES, st.sampled_from((1.0, 0.97, 1.02))),
    st.tuples(st.just("multiplexer"), SLAVES, st.booleans()),
    st.tuples(st.just("cell"), CELLS, st.floats(0.0, 5.7)),
    st.tuples(st.just("sensor"), CELLS, st.floats(0.0, 3.0)),
)
PASSES = st.lists(
    st.tuples(
        st.lists(EVENTS, max_size=3),
        st.frozensets(st.sampled_from(PACKETS), max_size=6),
        st.booleans(),  # temperatures
        st.integers(0, 4),  # stages of the check
        st.none() | st.frozensets(CELLS, max_size=10),  # cells to bleed
    ),
    min_size=1,
    max_size=8,
)


def befall(chain: DamagedChain, kind: str, where: int, how: float) -> None:
    converters = chain.converters
    match kind:
        case "power":
            chain.set_powered(where, bool(how))
        case "wire":
            converters.open_wires.add(where) if how else converters.open_wires.discard(where)
        case "stick":
            converters.stick(where, int(how))
        case "drift":
            converters.drift(where, how)
        case "multiplexer":
            converters.multiplexer_failed[where] = how
        case "cell":
            converters.cell_v = np.where(np.arange(96) == where, how, converters.cell_v)
        case "sensor":
            converters.sensor_v = np.where(np.arange(96) == where, how, converters.sensor_v)


def play(library: ctypes.CDLL, passes: list, inputs: tuple[int, ...]) -> None:
    """Read under faults; what is said to be known is what the chip has measured, and nothing of a lost slave is."""
    c = started(library, inputs)
    chain = c.chain
    for number, (events, damaged, temperatures, stages, bled) in enumerate(passes, 1):
        for event in events:
            befall(chain, *event)
        chain.damaged = damaged
        c.begin(PASS_S * number)
        c.read_voltages()
        measured = chain.converters.cvr.copy()
        if temperatures:
            c.read_temperatures()
        for _ in range(stages):
            c.self_check()
        if bled is not None:
            c.configure(np.isin(np.arange(96), [*bled]))
            unread = {slave for kind, slave, _ in damaged if kind == 2} | set(np.flatnonzero(~chain.is_powered))
            of_slaves = c.memory.slave_cfgr[:, 4:], chain.cfgr[:, 4:]
            held, there = ([group.tobytes() for group in groups & [0xFF, 0x0F]] for groups in of_slaves)
            assert [held[k] for k in range(8) if k not in unread] == [there[k] for k in range(8) if k not in unread]
        known = np.reshape(c.known(), (8, 12))
        arrived = np.ones((8, 12), dtype=bool)
        for kind, slave, at in damaged:
            if kind == 0:
                arrived[slave, 3 * at : 3 * at + 3] = False
        assert np.array_equal(c.memory.slave_cvr[known & arrived], measured[known & arrived])
        assert not known[~chain.is_powered].any()
        assert list(np.array(c.slaves.is_silent) | chain.is_powered) == [True] * 8
        missing = np.reshape(c.temperatures_degc(), (8, 12)) == T_MISSING
        assert missing[np.array(c.slaves.is_silent)].all()


@settings(max_examples=examples(100), deadline=None)
@given(passes=PASSES, inputs=st.sampled_from((INPUTS, tuple(range(12)))) | st.permutations(range(12)).map(tuple))
def test_what_is_known_is_what_the_chips_have_measured(library, passes, inputs):
    play(library, passes, inputs)


def test_what_each_fault_does_to_the_values(library):
    c = started(library)
    chain = c.chain
    chain.set_powered(5, False)
    chain.converters.open_wires.add(2)
    chain.converters.stick(1, 0x80)
    chain.converters.multiplexer_failed[6] = True
    chain.converters.drift(7, 0.99)
    chain.converters.sensor_v = np.where(np.arange(96) == 38, 0.0, np.full(96, 1.86))
    for number in range(1, 6):
        c.begin(PASS_S * number)
        assert c.read_voltages() == 1
        c.read_temperatures()
        c.self_check()
    assert list(c.slaves.failures) == [0, 7, 0, 0, 0, 0, 8, 16]
    assert np.flatnonzero(~np.array(c.known())).tolist() == [2, 3, *range(12, 24), *range(60, 96)]
    missing = set(np.flatnonzero(np.array(c.temperatures_degc()) == T_MISSING).tolist())
    # the fourth slave's input 3 carries the sensor of its second cell; the first one's 2 and 3 are at the open wire
    assert missing == {INPUTS.index(2), INPUTS.index(3), 37, *range(60, 72)}
    assert c.memory.slave_status.tolist() == [1, 255, 1, 1, 1, 255, 255, 255]
    flags = StatusB.from_bytes(c.memory.slave_str[6, 3:].astype("<u2").tobytes())
    assert flags.multiplexer_failed


@pytest.mark.parametrize(("wire", "cells"), [(2, [2, 3]), (11, [11]), (95, [95]), (47, [47]), (40, [40, 41])])
def test_an_open_wire_takes_the_voltages_on_both_sides_until_it_is_back(library, wire, cells):
    c = started(library)
    wires = c.chain.converters.open_wires
    for number, is_open in ((1, True), (2, False)):
        wires.add(wire) if is_open else wires.clear()
        for stage in range(4):
            c.begin(0.2 * number + 0.03 * stage)
            c.read_voltages()
            assert c.self_check() == (stage == 3)
        assert np.flatnonzero(~np.array(c.known())).tolist() == (cells if is_open else [])


def test_a_conversion_that_never_begins_is_asked_for_three_times(library):
    """The chips convert nothing, as with all commands damaged; the driver goes on with what it has."""
    c = started(library)
    chain = c.chain
    chain.damaged = frozenset({(0, 0, 0)})
    c.begin(0.1)
    c.read_voltages()
    chain.bit_error_rate = 1.0
    c.log.clear()
    c.begin(0.12)
    assert c.read_voltages() == 8
    asked = [packet[:2].hex() for _, packet in c.log if packet[:2].hex() in ("03e0", "0714")]
    assert asked == ["03e0", "0714"] * 3
    c.log.clear()
    c.read_temperatures()
    assert sum(packet[:2].hex() == "0001" for _, packet in c.log) == 3 + 1  # sensors in, and what is bled again
    assert not any(c.known())


def test_on_a_noisy_pair_commands_are_repeated(library):
    chain = DamagedChain(INPUTS)
    c = CReader(library, chain)
    c.start(0.0)
    chain.bit_error_rate = 1e-3
    missing = 0
    for k in range(1, 40):
        c.begin(0.5 * k, 500)
        c.read_voltages()
        for part in range(2):
            c.begin(0.5 * k + 0.1 * (part + 1), 100)
            c.read_temperatures()
        missing += c.temperatures_degc().count(T_MISSING)
    assert c.slaves.packet_errors > 100
    assert Command.PLADC in {int.from_bytes(packet[:2], "big") for _, packet in c.log}
    assert missing < 250 + 39 * 8  # four sensors of 96 are outside their curve; every damaged command loses 48


def test_the_noise_is_forgotten_after_a_quiet_minute(library):
    c = started(library)
    c.chain.damaged = frozenset({(0, 2, 1)})
    c.begin(0.1)
    c.read_voltages()
    c.chain.damaged = frozenset()
    for k in range(1, 3001):
        c.library.vw_slaves_begin(byref(c.slaves), c_uint32(20))
        assert (c.slaves.noisy_ms_left == 0) == (k == 3000)


def exercise(path: str) -> None:
    """Read under faults with a library that only this process may load."""
    library = load(Path(path))
    events = [("power", 3, False), ("wire", 11, True), ("stick", 1, 0x80)]
    damaged = frozenset({(0, 2, 1), (1, 4, 3), (2, 6, 0)})
    play(
        library,
        [(events, damaged, True, 4, frozenset({1, 50})), ([("power", 3, True)], frozenset(), True, 4, None)],
        INPUTS,
    )


def test_no_byte_outside_its_arrays_is_touched():
    path = slaves_library(*ADDRESS)
    found = subprocess.run(["gcc", "-print-file-name=libasan.so"], capture_output=True, text=True, check=True)
    if not Path(preloaded := found.stdout.strip()).is_absolute():
        pytest.skip("a gcc without its address sanitizer")
    call = f"from tests.property.test_c_slaves import exercise; exercise({str(path)!r})"
    environment = {
        **os.environ,
        "LD_PRELOAD": preloaded,
        "ASAN_OPTIONS": "detect_leaks=0",
        "PYTHONPATH": str(Path.cwd()),
    }
    ran = subprocess.run([sys.executable, "-c", call], env=environment, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr[-2000:]
