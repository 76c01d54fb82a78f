import numpy as np
import pytest

from simulator.accumulator import Accumulator, AccumulatorParameters
from simulator.balancing.choices import METHODS
from simulator.balancing.circuits import balancing_circuit

N = 24
STEP_S = 5.0


@pytest.fixture
def accumulator() -> Accumulator:
    soc = np.full(N, 0.6)
    soc[3] = 0.65
    spreads = dict.fromkeys(("capacity_spread", "resistance_spread", "start_soc_spread"), 0.0)
    parameters = AccumulatorParameters(n_cells=N, cells_per_pack=12, start_soc=soc, **spreads)
    return Accumulator(parameters, np.random.default_rng(1))


def outputs(*cells: int) -> np.ndarray:
    chosen = np.zeros(N)
    chosen[list(cells)] = 1.0
    return chosen


def hour(accumulator: Accumulator, method: str, *cells: int) -> np.ndarray:
    """Return the change of each cell's charge [Ah] in an hour of balancing at rest."""
    circuit, before = balancing_circuit(method, accumulator), accumulator.soc.copy()
    for _ in range(round(3600 / STEP_S)):
        balance = circuit.drive(outputs(*cells), accumulator, STEP_S)
        accumulator.step(
            STEP_S,
            0.0,
            bleeding=balance.bleeding,
            cell_current_a=balance.cell_current_a,
            balancer_heat_w=balance.heat_w,
        )
    return (accumulator.soc - before) * accumulator.capacity_ah


@pytest.mark.parametrize("method", METHODS)
def test_the_full_cell_comes_down_whatever_the_circuit(accumulator, method):
    moved = hour(accumulator, method, 3)
    assert moved[3] < -0.1
    assert accumulator.bleed_energy_j > 0.0
    np.testing.assert_allclose(moved[12:], 0.0, atol=1e-2)  # the other pack only discharges itself


def test_resistors_give_the_other_cells_nothing(accumulator):
    moved = hour(accumulator, "passive", 3)
    assert np.delete(moved, 3).max() <= 0.0


@pytest.mark.parametrize("method", ["switched-capacitor", "transformer"])
def test_an_active_circuit_gives_most_of_the_charge_to_the_pack(accumulator, method):
    moved = hour(accumulator, method, 3)
    given = np.delete(moved[:12], 3)
    assert given.min() > 0.0
    assert given.sum() > -0.5 * moved[3]


@pytest.mark.parametrize("method", METHODS)
def test_open_outputs_move_no_charge(accumulator, method):
    balance = balancing_circuit(method, accumulator).drive(outputs(), accumulator, 1.0)
    assert balance.cell_current_a is None or not balance.cell_current_a.any()
    assert balance.bleeding is None or not balance.bleeding.any()


def test_windings_of_one_pack_take_turns(accumulator):
    circuit = balancing_circuit("transformer", accumulator)
    one = circuit.drive(outputs(3), accumulator, 1.0)
    two = circuit.drive(outputs(3, 5), accumulator, 1.0)
    assert two.loss_w == pytest.approx(one.loss_w, rel=0.2)
    assert two.cell_current_a[3] < one.cell_current_a[3]
