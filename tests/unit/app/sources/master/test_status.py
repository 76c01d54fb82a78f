"""What the car does by the master's flags: the gravest first, and unknown where a flag is."""

from itertools import product

import pytest

from app.sources.master.events import state_of
from app.telemetry import Flags
from app.words import Message, render
from firmware_protocol.memory_map import STATUS_FLAGS

TRIP = Message("cell-overtemperature")


def flags(*on, **said):
    return Flags(**({name: name in on for name in STATUS_FLAGS} | said))


@pytest.mark.parametrize(
    ("given", "state", "why"),
    [
        (flags("fit"), "idle", "relays open"),
        (flags("fit", "charger"), "idle", "charger connected, not charging"),
        (flags("fit", "load"), "drive", "relays closed"),
        (flags("fit", "charger", "charging"), "charge", "charger: constant current"),
        (flags("fit", "balancing"), "balance", "cells are bled to the lowest"),
        (flags("fit", "charging", "balancing"), "charge", "charger: constant current"),
        (flags("fit", "balancing", "load"), "balance", "cells are bled to the lowest"),
        (flags("fit", load=None), "unknown", "nothing heard of the relays"),
        (flags("fit", "charging", load=None), "charge", "charger: constant current"),
        (flags("load"), "fault", "cell overtemperature"),
        (None, "unknown", "no status from the master"),
    ],
)
def test_flags_tell_what_the_car_does_and_why(given, state, why):
    found, told = state_of(given, "constant_current", TRIP)
    assert (found, render(told)) == (state, why)


def test_a_fault_whose_reason_nobody_told_is_the_open_circuit():
    state, why = state_of(flags(), None, None)
    assert (state, render(why)) == ("fault", "the master holds the shutdown circuit open")


def test_an_older_trip_is_no_reason_while_all_is_well():
    _, why = state_of(flags("fit"), None, TRIP)
    assert render(why) == "relays open"


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
