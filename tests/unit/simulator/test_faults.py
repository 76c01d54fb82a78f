import numpy as np
import pytest

from simulator.accumulator import AccumulatorParameters
from simulator.errors import FaultError
from simulator.fault_kinds import FAULTS, Target
from simulator.faults import FaultBoard
from simulator.simulation import Simulation


@pytest.fixture
def simulation() -> Simulation:
    return Simulation(AccumulatorParameters())


def state(simulation: Simulation) -> list[object]:
    """Return everything that faults change, comparable."""
    accumulator, board = simulation.accumulator, simulation.board
    converters = board.chain.converters
    arrays = (
        accumulator.extra_joint_ohm, accumulator.capacity_factor, accumulator.resistance_factor, accumulator.short_s,
        accumulator.heat_w, board.cell_inputs.stuck_v, board.cell_inputs.extra_noise_v,
        board.cell_inputs.temperature_stuck_degc, board.cell_inputs.temperature_unplugged, board.chain.is_powered,
        converters.stuck_bits, converters.reference_factor, converters.multiplexer_failed,
    )  # fmt: skip
    unit, line = simulation.charger.unit, simulation.line
    return [
        *(np.array2string(array, threshold=200) for array in arrays),
        accumulator.fan_blocked, accumulator.ambient_degc, frozenset(converters.open_wires),
        board.chain.bit_error_rate, board.current_sensor.is_unplugged, board.current_sensor.extra_offset_a,
        frozenset(board.eeprom.worn_pages), line.noise_per_byte, line.is_dropping, line.is_stuck,
        simulation.is_shutdown_open,
        simulation.link.leak_ohm, simulation.link.is_precharge_open, simulation.link.is_discharge_open,
        simulation.master_on_bus.is_held_off, simulation.bus.is_broken, simulation.bus.noise_per_bit,
        simulation.babbler.share, unit.extra_heat_w, unit.has_mains, unit.is_reversed,
        unit.is_silent, unit.has_hardware_fault, simulation.master is None,
    ]  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_each_fault_changes_something_and_leaves_nothing_behind(simulation, name):
    board = FaultBoard(simulation)
    target = 0 if FAULTS[name].target is Target.NONE else 5
    before = state(simulation)
    board.inject(name, target)
    assert state(simulation) != before
    if not FAULTS[name].is_instant:
        assert [fault.name for fault in board.active] == [name]
        board.clear(name, target)
        assert state(simulation) == before
    assert board.active == ()


def test_a_fault_ends_after_its_time(simulation):
    board = FaultBoard(simulation)
    board.inject("slave-lost", 3, for_s=10)
    board.step(9.9)
    assert not simulation.board.chain.is_powered[3]
    board.step(10.0)
    assert simulation.board.chain.is_powered[3]


def test_the_same_fault_again_replaces_the_first(simulation):
    board = FaultBoard(simulation)
    board.inject("joint-resistance-high", 7, 1.0, for_s=1)
    board.inject("joint-resistance-high", 7, 5.0)
    board.inject("joint-resistance-high", 8, 2.0)
    board.step(100.0)
    assert simulation.accumulator.extra_joint_ohm[[7, 8]] == pytest.approx([5e-3, 2e-3])
    board.clear_all()
    assert not simulation.accumulator.extra_joint_ohm.any()


@pytest.mark.parametrize(
    ("name", "target", "value", "for_s"),
    [
        ("flat-tyre", 0, None, None),
        ("joint-resistance-high", 96, None, None),
        ("slave-lost", 8, None, None),
        ("current-sensor-offset", 1, None, None),
        ("joint-resistance-high", 0, 51.0, None),
        ("joint-resistance-high", 0, float("nan"), None),
        ("joint-resistance-high", 0, 1.0, 0.0),
        ("joint-resistance-high", 0, 1.0, float("nan")),
        ("joint-resistance-high", 0, 1.0, 1e9),
        ("slave-adc-fault", 0, 7.5, None),
        ("master-supply-lost", 0, 1.0, 5.0),
    ],
)
def test_what_cannot_be_is_refused(simulation, name, target, value, for_s):
    with pytest.raises(FaultError):
        FaultBoard(simulation).inject(name, target, value, for_s)
