"""The whole master in C on the simulated car: its slaves over the bytes of their pair, its struct, link and relays."""

import numpy as np
import pytest

from firmware_protocol.framing import Frame, FrameDecoder
from firmware_protocol.memory_map import FIELDS
from firmware_protocol.messages import CommandId, EventCode, decode_message
from simulator.accumulator import AccumulatorParameters
from simulator.loads import ConstantCurrent
from simulator.relays import RelayState
from simulator.simulation import Simulation
from tests.c_virtual_master import CarWithWholeCMaster


def drive(car: type[Simulation]) -> tuple[list, Simulation, list]:
    """Boot, measure, drive, trip on a cell, clear, drive on; return the events, the car, and what was measured."""
    simulation = car(AccumulatorParameters(start_soc=0.7, start_soc_spread=0.002), seed=5)
    events, decoder, images = [], FrameDecoder(), []

    def take(data: bytes) -> None:
        for item in decoder.feed(data):
            assert isinstance(item, Frame)
            message = decode_message(item)
            events.append((simulation.now_s, EventCode(message.code), message.cell))

    simulation.serial_out = take
    for until_s, change in (
        (0.6, lambda: simulation.set_load(ConstantCurrent(40.0))),
        (2.6, lambda: hold(simulation, 41, 2.3)),
        (3.4, lambda: hold(simulation, 41, np.nan)),
        (3.8, lambda: simulation.master.command(CommandId.CLEAR_FAULTS, 0, simulation.now_s)),
        (6.0, lambda: None),
    ):
        simulation.run_until(until_s)
        images.append((bytes(simulation.master.memory.image), simulation.master.relay_state))
        change()
    return events, simulation, images


def hold(simulation: Simulation, cell: int, volts: float) -> None:
    simulation.board.cell_inputs.stuck_v[cell] = volts
    simulation.board.cell_inputs.faults_changed()


@pytest.fixture(scope="module")
def both():
    return drive(Simulation), drive(CarWithWholeCMaster)


def test_it_boots_measures_drives_trips_on_a_cell_and_drives_again(both):
    _, (events, simulation, images) = both
    relays = [state for _, state in images]
    assert relays == [RelayState.OPEN, RelayState.VEHICLE, RelayState.OPEN, RelayState.OPEN, RelayState.VEHICLE]
    trips = [(at_s, code, cell) for at_s, code, cell in events if code.name.startswith("TRIP_")]
    ((at_s, code, cell),) = trips
    assert (code, cell) == (EventCode.TRIP_V_MIN, 41)
    assert 2.9 <= at_s < 3.1  # FS rules EV 5.8.7: within 500 ms
    assert simulation.current_a == pytest.approx(40.0)
    assert FIELDS["n_slaves"].unpack(simulation.master.memory.image) == (8,)


def test_its_values_are_those_of_the_cells(both):
    _, (_, simulation, _) = both
    memory, accumulator = simulation.master.memory, simulation.accumulator
    np.testing.assert_allclose(memory.v * 1e-4, accumulator.terminal_voltage_v, atol=3e-3)
    np.testing.assert_allclose(memory.t, accumulator.temperature_degc, atol=1.5)
    assert FIELDS["i_fc"].unpack(memory.image)[0] * 0.01 == pytest.approx(40.0, abs=1.0)


def test_the_virtual_master_tells_the_same_at_the_same_time(both):
    (python, *_), (c, *_) = both
    assert [(code, cell) for _, code, cell in c] == [(code, cell) for _, code, cell in python]
    np.testing.assert_allclose([at_s for at_s, *_ in c], [at_s for at_s, *_ in python], atol=0.045)


@pytest.mark.parametrize("at", range(1, 5))
def test_the_virtual_master_measures_the_same(both, at):
    """Not to the last count: the two take the same noise at other moments of a pass."""
    (*_, python), (*_, c) = both
    for name, atol in (("v", 12), ("t", 1), ("v_avg", 8), ("t_avg", 1), ("soc", 2)):
        field = FIELDS[name]
        np.testing.assert_allclose(field.unpack(c[at][0]), field.unpack(python[at][0]), atol=atol)
    assert c[at][1] is python[at][1]
