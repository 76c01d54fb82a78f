"""Events of the master: severity, cell, unit and why the relays opened; its state by its flags."""

from itertools import product

import pytest

from app.sources.master.events import charger_state, describe, state_of
from app.telemetry import Flags
from app.words import Message, render
from app.words.conditions import CONDITIONS
from firmware_protocol.memory_map import CHARGER_STATES, STATUS_FLAGS
from firmware_protocol.messages import NO_OFFSET, EventCode, EventMessage

T_NS = 1_780_000_000_000_000_000
SEGMENTS = (12,) * 8
TRIP = Message("cell-overtemperature")


def described(code, value=0, limit=0, cell=NO_OFFSET):
    return describe(EventMessage(code, 0, cell, value, limit), T_NS)


@pytest.mark.parametrize(
    ("code", "cell", "counts", "value", "unit", "text"),
    [
        (EventCode.TRIP_V_MIN, 36, (24_990, 25_000), (2.499, 2.5), "V",
         "cell undervoltage, pack 4, cell 1: 2.499 V, limit 2.5 V"),
        (EventCode.TRIP_V_MAX, 0, (42_013, 42_000), (4.2013, 4.2), "V",
         "cell overvoltage, pack 1, cell 1: 4.2013 V, limit 4.2 V"),
        (EventCode.TRIP_T_MIN, 95, (-16, -15), (-16.0, -15.0), "degC", None),
        (EventCode.TRIP_T_MAX, 12, (61, 60), (61.0, 60.0), "degC", None),
        (EventCode.TRIP_I_DISC, NO_OFFSET, (20_100, 20_000), (201.0, 200.0), "A", None),
        (EventCode.TRIP_I_CHRG, NO_OFFSET, (-10_100, -10_000), (-101.0, -100.0), "A", None),
    ],
)  # fmt: skip
def test_a_trip_tells_value_and_limit_in_the_unit_of_what_tripped(code, cell, counts, value, unit, text):
    event, reason = described(code, *counts, cell=cell)
    assert (event.severity, event.time_ns, event.unit) == ("trip", T_NS, unit)
    assert event.code.removeprefix("trip-") in CONDITIONS
    assert (event.value, event.limit) == pytest.approx(value)
    assert event.cell == (None if cell == NO_OFFSET else cell)
    assert reason is not None
    said = render(reason, SEGMENTS)
    assert text is None or said == text
    assert all(f"{number:g} {unit if unit != 'degC' else ''}".strip() in said for number in value)


@pytest.mark.parametrize(
    ("code", "cell", "text"),
    [
        (EventCode.TRIP_SLAVE_LOST, None, "slave board of pack 3 lost"),
        (EventCode.TRIP_SENSOR_LOST, 24, "sensor lost, pack 3, cell 1"),
    ],
)
def test_what_is_lost_has_a_place_and_no_value(code, cell, text):
    event, reason = described(code, cell=24)
    assert (event.severity, event.cell) == ("trip", cell)
    assert render(reason, SEGMENTS) == text
    assert "pack" not in render(described(code)[1], SEGMENTS)


@pytest.mark.parametrize("cell", [96, 200, NO_OFFSET])
def test_a_cell_that_there_is_not_is_none(cell):
    assert described(EventCode.TRIP_V_MAX, 42_013, 42_000, cell)[0].cell is None


@pytest.mark.parametrize(
    ("code", "value", "severity", "words"),
    [
        (EventCode.BOOT, 0, "watch", "power"),
        (EventCode.BOOT, 1, "watch", "watchdog"),
        (EventCode.BOOT, 2, "watch", "brown-out"),
        (EventCode.BOOT, 9, "watch", "9"),
        (EventCode.BOOT, -1, "watch", "-1"),
        (EventCode.FAULTS_CLEARED, 0, "info", "faults cleared"),
        (EventCode.CONFIG_STORED, 17, "info", "17"),
        (EventCode.CAN_RX_TIMEOUT, 3, "watch", "3"),
        (EventCode.EEPROM_INVALID, 0, "warning", "EEPROM"),
        (EventCode.SOC_SET, 9991, "info", "99.91"),
    ],
)
def test_what_is_no_trip_is_as_grave_as_it_is_and_opens_nothing(code, value, severity, words):
    event, reason = described(code, value)
    assert (event.severity, event.code) == (severity, code.name.lower().replace("_", "-"))
    assert words in render(event.message)
    assert reason is None


def test_an_event_of_a_later_firmware_is_told_with_its_numbers():
    event, reason = described(77, 5, -6)
    assert (event.severity, event.code, reason) == ("info", "master-event", None)
    assert all(number in render(event.message) for number in ("77", "5", "-6"))


def test_every_state_of_the_charger_has_words_of_its_own():
    said = {render(charger_state(state)) for state in CHARGER_STATES}
    assert len(said) == len(CHARGER_STATES)
    assert render(charger_state(None)) not in said
    assert render(charger_state("later")) == render(charger_state(None))
    for value, state in enumerate(CHARGER_STATES):
        assert render(charger_state(state)) in render(described(EventCode.CHARGER_STATE, value)[0].message)
    assert render(described(EventCode.CHARGER_STATE, 99)[0].message)


@pytest.mark.parametrize("code", list(EventCode))
@pytest.mark.parametrize("language", ["en", "nb"])
def test_every_event_has_words_in_every_language(code, language):
    text = render(described(code, 1, 2, 3)[0].message, language=language)
    assert text
    assert "{" not in text
    assert text != code.name.lower().replace("_", "-")


def flags(*on, **said):
    return Flags(**({name: name in on for name in STATUS_FLAGS} | said))


@pytest.mark.parametrize(
    ("given", "state", "why"),
    [
        (flags("fit"), "idle", "contactors open"),
        (flags("fit", "charger"), "idle", "charger connected, not charging"),
        (flags("fit", "load"), "drive", "contactors closed"),
        (flags("fit", "charger", "charging"), "charge", "charger: constant current"),
        (flags("fit", "balancing"), "balance", "balancing: cells discharged to the lowest"),
        (flags("fit", "charging", "balancing"), "charge", "charger: constant current"),
        (flags("fit", "balancing", "load"), "balance", "balancing: cells discharged to the lowest"),
        (flags("fit", load=None), "unknown", "no contactor state received"),
        (flags("fit", "charging", load=None), "charge", "charger: constant current"),
        (flags("load"), "fault", "cell overtemperature"),
        (None, "unknown", "no status received from the master"),
    ],
)
def test_flags_tell_what_the_car_does_and_why(given, state, why):
    found, told = state_of(given, "constant_current", TRIP)
    assert (found, render(told)) == (state, why)


def test_a_car_that_is_not_fit_is_in_fault_whatever_else_it_says():
    names = [name for name in STATUS_FLAGS if name != "fit"]
    for chosen in product((False, True), repeat=len(names)):
        on = [name for name, is_on in zip(names, chosen, strict=True) if is_on]
        assert state_of(flags(*on), None, None)[0] == "fault"


def test_usb_and_the_buses_change_nothing():
    for chosen in product((False, True), repeat=4):
        on = [name for name, is_on in zip(("usb", "i2c1", "usart1", "can1"), chosen, strict=True) if is_on]
        assert state_of(flags("fit", "load", *on), None, None)[0] == "drive"


@pytest.mark.parametrize("charging", [None, "later"])
def test_a_charger_in_a_state_that_nobody_knows_says_so(charging):
    state, why = state_of(flags("fit", "charging"), charging, None)
    assert (state, render(why)) == ("charge", "charger: state unknown")
