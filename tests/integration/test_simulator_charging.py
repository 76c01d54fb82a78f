"""Charges of the whole simulated car at its real pass of 20 ms, with the true voltages seen at every pass."""

import pytest

from firmware_protocol.config_image import default_image, with_value
from firmware_protocol.eeprom import plan_store
from firmware_protocol.messages import CommandId
from simulator.accumulator import AccumulatorParameters
from simulator.bms_state import ChargingState
from simulator.eeprom import Eeprom
from simulator.faults import FaultBoard
from simulator.simulation import Simulation
from tests.campaign import SIZE
from tests.master_memory import Config

LIMIT_S = 900.0
long = pytest.mark.skipif(SIZE == "sample", reason="minutes of passes of 20 ms: in the campaign")


@pytest.mark.parametrize(
    ("start_soc", "joint_milliohm", "config"),
    [
        (0.957, 0.0, {}),
        (0.955, 20.0, {}),
        (0.958, 20.0, {}),
        pytest.param(0.957, 0.0, {"i_chrg_max": 2.0}, marks=long),
        pytest.param(0.9925, 0.0, {"v_cell_chrg": 4.2}, marks=long),
    ],
    ids=["sound", "loose joint", "loose joint, nearly full", "2 A", "to the trip"],
)
def test_a_charge_ends_and_no_cell_is_lifted_over_its_limit(start_soc, joint_milliohm, config):
    image, eeprom = default_image(), Eeprom()
    for name, value in config.items():
        image = with_value(image, name, value)
    for page in plan_store(bytes(eeprom.content), image):
        eeprom.write(page.offset, page.data)
    parameters = AccumulatorParameters(start_soc=start_soc, start_soc_spread=0.0005)
    simulation = Simulation(parameters, eeprom=eeprom, seed=3)
    simulation.run_until(1.0)
    simulation.charger.is_plugged = True
    if joint_milliohm:
        FaultBoard(simulation).inject("joint-resistance-high", 30, joint_milliohm)
    simulation.run_until(3.0)
    simulation.master.command(CommandId.CHARGE_START, 0, simulation.now_s)
    highest_v = 0.0
    while simulation.master.charging.is_active and simulation.now_s < LIMIT_S:
        simulation.run_until(simulation.now_s + simulation.step_s)
        highest_v = max(highest_v, float(simulation.accumulator.terminal_voltage_v.max()))
    assert simulation.master.charging.state is ChargingState.DONE
    assert simulation.master.is_ok
    limit_v = Config.from_image(simulation.master.image).v_cell_chrg * 1e-4
    assert limit_v - 6e-3 < highest_v < limit_v + 2e-3
