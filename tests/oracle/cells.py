"""States and setups that tests of the oracle start from."""

from dataclasses import replace

import numpy as np

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.engine.native import NativeEngine
from app.estimation.filters.estimates import Estimates
from app.estimation.filters.setup import FilterSetup, Kind
from app.estimation.filters.sigma_points import central_difference
from app.estimation.filters.tables import CellTables
from app.estimation.filters.tuning import Tuning
from tests.oracle.state import Motion, State, initial_state, motion_of, read

MODEL = load_cell("samsung-25r-10p")
#: the same cell with a SOC at the surface and an exchange current over SOC and temperature
SURFACE = replace(
    MODEL,
    overpotential_v=np.full(MODEL.r0_ohm.shape, 0.03),
    reference_a=15.0 * (0.2 + MODEL.soc_grid) * np.linspace(0.5, 1.5, MODEL.temperature_grid_degc.size)[:, None],
    surface_per_a=np.linspace(2e-3, 5e-4, MODEL.temperature_grid_degc.size) * np.array([[0.3], [1.0]]),
)
KNOWN_V2 = 1e-10  # variance of a lasting error that plays no part in a test


def setup_of(model=MODEL, kind=Kind.SIGMA_FUSED, rule=central_difference, tuning=None) -> FilterSetup:
    """A filter of the model, a fused central-difference one unless told otherwise."""
    return FilterSetup(CellTables(model), kind, rule and rule(2 + model.n_rc), tuning or Tuning())


def state_at(setup: FilterSetup, soc, variance=1e-4, branch_v2=1.0) -> State:
    """Cells at a SOC that both filter and count believe in, RC currents and lasting error 0, the latter known."""
    soc = np.atleast_1d(np.asarray(soc, dtype=float))
    state = initial_state(setup, soc.size)
    cov = state.cov.copy()
    for u, own in enumerate((variance, *np.full(setup.cell.n_rc - 1, branch_v2), KNOWN_V2)):
        cov[u, u] = own
    return replace(state, soc=soc, cov=cov, count_soc=soc, anchor_v2=np.full(soc.size, 1e-4))


def sample(setup: FilterSetup, state: State, volts=3.7, degc=25.0, dt_s=1.0, current_a=0.0):
    """The state, the step and the measurement of one sample."""
    rows = [np.broadcast_to(np.asarray(values, dtype=float), state.soc.shape) for values in (volts, degc)]
    state, measured = read(setup, state, *rows)
    motion: Motion = motion_of(setup, dt_s, current_a)
    return state, motion, measured


class NativeCells:
    """Cells of the C engine that begin as `state_at` says; `state` is what it keeps now."""

    def __init__(self, soc, variance=1e-4, branch_v2=1.0, **setup):
        self.setup = setup_of(**setup)
        state = state_at(self.setup, soc, variance, branch_v2)
        self._engine = NativeEngine(self.setup, state.soc.size)
        for name, values in vars(state).items():
            self._engine.set(name, values)

    @property
    def state(self) -> State:
        return State(**{name: self._engine.get(name) for name in State.__dataclass_fields__})

    def step(self, volts, dt_s=1.0, current_a=0.0) -> Estimates:
        rows = [np.broadcast_to(np.asarray(values, float), (self._engine.n_cells,)) for values in (volts, 25.0)]
        return Estimates(self._engine.step(dt_s, current_a, *rows))
