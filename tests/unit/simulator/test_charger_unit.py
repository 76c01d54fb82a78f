import pytest

from firmware_protocol.elcon import ChargerCommand, ChargerFlags, ChargerStatus
from simulator.charger_unit import ChargerUnit

BATTERY_OHM = 0.3


def charge(
    unit: ChargerUnit, emf_v: float, seconds: float, dt_s: float = 0.1, command: ChargerCommand | None = None
) -> list[ChargerStatus]:
    """Run the unit on a battery of fixed voltage, commanding once a second if there is a command."""
    received = []
    for step in range(round(seconds / dt_s)):
        if command is not None and step % max(1, round(1.0 / dt_s)) == 0:
            unit.receive(command.to_bytes())
        data = unit.step(dt_s, emf_v + unit.current_a * BATTERY_OHM)
        if data is not None:
            received.append(ChargerStatus.from_bytes(data))
    return received


def test_announces_itself_once_a_second_before_any_command():
    received = charge(ChargerUnit(), 350.0, 10.0)
    assert len(received) == 10
    assert all(status.flags & ChargerFlags.TIMEOUT and status.current_a == 0.0 for status in received)


def test_ramps_to_the_commanded_current_and_no_further():
    unit = ChargerUnit()
    command = ChargerCommand(400.0, 12.0, is_charging=True)
    charge(unit, 350.0, 2.0, command=command)
    assert 2.0 < unit.current_a < 4.1  # 2 A/s
    charge(unit, 350.0, 10.0, command=command)
    assert unit.current_a == pytest.approx(12.0, abs=1e-6)


def test_power_limit_holds():
    unit = ChargerUnit()
    charge(unit, 395.0, 30.0, command=ChargerCommand(420.0, 18.0, is_charging=True))
    assert unit.current_a * unit.voltage_v == pytest.approx(6600.0, rel=0.01)


@pytest.mark.parametrize("dt_s", [0.01, 0.1, 1.0])
def test_holds_the_commanded_voltage_without_overshoot(dt_s):
    unit = ChargerUnit()
    command = ChargerCommand(398.4, 12.0, is_charging=True)
    highest_v = 0.0
    for _ in range(round(60.0 / dt_s)):
        unit.receive(command.to_bytes())
        unit.step(dt_s, 397.0 + unit.current_a * BATTERY_OHM)
        highest_v = max(highest_v, 397.0 + unit.current_a * BATTERY_OHM)
    set_v = 398.4 / unit.parameters.voltage_gain
    assert unit.voltage_v == pytest.approx(set_v, abs=0.01)
    assert highest_v <= set_v + 0.05


def test_stops_five_seconds_after_the_last_command_and_resumes_with_the_next():
    unit = ChargerUnit()
    command = ChargerCommand(400.0, 10.0, is_charging=True)
    charge(unit, 350.0, 10.0, command=command)
    charge(unit, 350.0, 3.8)  # the last command came 0.9 s before
    assert unit.current_a > 9.9
    received = charge(unit, 350.0, 1.5)
    assert unit.current_a == 0.0
    assert received[-1].flags == ChargerFlags.TIMEOUT
    charge(unit, 350.0, 10.0, command=command)
    assert unit.current_a > 9.9


def test_control_byte_stops_without_any_flag():
    unit = ChargerUnit()
    charge(unit, 350.0, 10.0, command=ChargerCommand(400.0, 10.0, is_charging=True))
    received = charge(unit, 350.0, 3.0, command=ChargerCommand(400.0, 10.0, is_charging=False))
    assert received[-1].current_a == 0.0
    assert received[-1].flags == ChargerFlags(0)


@pytest.mark.parametrize(
    ("attribute", "value", "flag"),
    [
        ("has_mains", False, ChargerFlags.INPUT_VOLTAGE),
        ("is_reversed", True, ChargerFlags.BATTERY),
        ("has_hardware_fault", True, ChargerFlags.HARDWARE),
    ],
)
def test_each_fault_stops_the_current_and_shows_its_flag(attribute, value, flag):
    unit = ChargerUnit()
    command = ChargerCommand(400.0, 10.0, is_charging=True)
    charge(unit, 350.0, 10.0, command=command)
    setattr(unit, attribute, value)
    received = charge(unit, 350.0, 2.0, command=command)
    assert received[-1].flags == flag
    assert unit.current_a == 0.0


def test_overheats_derates_first_then_stops_and_comes_back_when_cool():
    unit = ChargerUnit()
    command = ChargerCommand(400.0, 16.0, is_charging=True)
    charge(unit, 380.0, 30.0, command=command)
    full_a = unit.current_a
    unit.extra_heat_w = 1500.0
    currents = []
    while not unit.flags:
        charge(unit, 380.0, 5.0, dt_s=0.5, command=command)
        currents.append(unit.current_a)
    assert unit.flags == ChargerFlags.OVER_TEMPERATURE
    assert any(0.1 * full_a < current < 0.9 * full_a for current in currents)
    unit.extra_heat_w = 0.0
    charge(unit, 380.0, 600.0, dt_s=0.5, command=command)
    assert not unit.flags
    assert unit.current_a > 0.9 * full_a


def test_a_silent_unit_says_nothing_and_hears_nothing():
    unit = ChargerUnit()
    command = ChargerCommand(400.0, 10.0, is_charging=True)
    charge(unit, 350.0, 10.0, command=command)
    unit.is_silent = True
    assert charge(unit, 350.0, 8.0, command=command) == []
    assert unit.current_a == 0.0


def test_bytes_that_are_no_command_change_nothing():
    unit = ChargerUnit()
    assert not unit.receive(b"\x00" * 7)
    assert charge(unit, 350.0, 2.0)[-1].flags & ChargerFlags.TIMEOUT
