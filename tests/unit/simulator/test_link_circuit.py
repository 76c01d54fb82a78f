import math

import pytest

from firmware_protocol.messages import CommandId
from simulator.bms_state import RelayState
from simulator.faults import FaultBoard
from simulator.loads import ConstantCurrent
from simulator.vehicle import LinkCircuit

SOURCE_V = 400.0
PRECHARGE_LIMIT_S = 3.0  # limit of the firmware


def charged(circuit: LinkCircuit, for_s: float, step_s: float = 0.02) -> float:
    """Pre-charge, and return the charge that was drawn [A s]."""
    return sum(circuit.step(step_s, SOURCE_V, RelayState.PRECHARGE) * step_s for _ in range(round(for_s / step_s)))


@pytest.mark.parametrize("step_s", [0.01, 0.1, 0.9])
def test_precharge_is_an_exponential_at_any_step_length(step_s):
    circuit = LinkCircuit()
    drawn = charged(circuit, 0.9, step_s)
    assert circuit.voltage_v == pytest.approx(SOURCE_V * (1 - math.exp(-3)), rel=1e-9)
    assert drawn == pytest.approx(circuit.parameters.capacitance_f * circuit.voltage_v, rel=1e-9)


def test_a_leak_holds_the_link_below_its_divider():
    circuit = LinkCircuit()
    circuit.leak_ohm = 2000.0
    charged(circuit, 20.0)
    assert circuit.voltage_v == pytest.approx(SOURCE_V * 2000 / 2600)
    assert circuit.step(0.02, SOURCE_V, RelayState.PRECHARGE) == pytest.approx(SOURCE_V / 2600)


def test_a_burnt_resistor_charges_nothing():
    circuit = LinkCircuit()
    circuit.is_precharge_open = True
    assert charged(circuit, 5.0) == 0.0
    assert circuit.voltage_v == 0.0


def test_the_link_is_below_60_v_within_the_five_seconds_of_the_rules_unless_its_discharge_is_off():
    sound, faulty = LinkCircuit(), LinkCircuit()
    faulty.is_discharge_open = True
    for circuit in (sound, faulty):
        circuit.step(0.02, SOURCE_V, RelayState.VEHICLE)
        assert circuit.voltage_v == SOURCE_V
        for _ in range(250):
            assert circuit.step(0.02, SOURCE_V, RelayState.OPEN) == 0.0
    assert sound.voltage_v < 60.0
    assert faulty.voltage_v == SOURCE_V


@pytest.mark.parametrize("fault", ["precharge-failed", "dc-link-load"])
def test_a_car_whose_precharge_fails_does_not_drive_until_it_is_mended(host, fault):
    simulation = host.simulation
    faults = FaultBoard(simulation)
    faults.inject(fault)
    simulation.set_load(ConstantCurrent(50.0))
    host.run(PRECHARGE_LIMIT_S + 1.0)
    assert simulation.master.has_precharge_failed
    assert simulation.current_a == 0.0
    faults.clear_all()
    host.run(5.0)
    assert simulation.current_a == 0.0
    simulation.master.command(CommandId.CLEAR_FAULTS, 0, simulation.now_s)
    host.run(1.5)
    assert simulation.current_a == 50.0


def test_precharge_can_be_seen_by_the_current_sensor(host):
    host.simulation.set_load(ConstantCurrent(0.0))
    host.run(0.3)
    assert host.simulation.master.relay_state is RelayState.PRECHARGE
    assert 0.2 < host.simulation.current_a < 0.7
