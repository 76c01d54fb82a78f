"""Numbers of one kind of cell: what the electrical model needs, as tables and constants.

Data flows from here into `simulator.cell`; nothing here steps or keeps state. These are the simulated hardware's own
numbers: the estimator has its own model and never reads them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from simulator.errors import ParameterError

FloatArray: TypeAlias = npt.NDArray[np.float64]
BoolArray: TypeAlias = npt.NDArray[np.bool_]

GAS_CONSTANT_J_PER_MOL_K = 8.314462618
FARADAY_C_PER_MOL = 96485.33212
ZERO_DEGC_IN_K = 273.15
REFERENCE_DEGC = 25.0

SOC_GRID_START = -0.10
SOC_GRID_STOP = 1.10
OCV_GRID_POINTS = 1201  # 0.1 % apart
# beyond the grid a cell is empty: its voltage collapses to nothing, from where it gives no energy whatever is drawn
EMPTY_SOC = SOC_GRID_START - 0.03
# or overfull: it rises this far within this charge, where the electrolyte decomposes and holds it
OVERFULL_SOC = SOC_GRID_STOP + 0.05
OVERFULL_RISE_V = 0.65


@dataclass(frozen=True)
class Table:
    """A quantity over state of charge, joined by monotone cubics and held flat outside its ends."""

    soc: tuple[float, ...]
    value: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.soc) != len(self.value) or len(self.soc) < 2:
            raise ParameterError("table", (self.soc, self.value), "needs two or more points, equally many of both")
        if np.any(np.diff(self.soc) <= 0.0):
            raise ParameterError("table soc", self.soc, "must increase")

    def at(self, soc: FloatArray) -> FloatArray:
        """Return the values at `soc`, shape kept, by monotone cubic interpolation (Fritsch and Carlson, 1980)."""
        x = np.asarray(self.soc)
        y = np.asarray(self.value)
        slopes = monotone_slopes(x, y)
        clipped = np.clip(soc, x[0], x[-1])
        left = np.clip(np.searchsorted(x, clipped, side="right") - 1, 0, len(x) - 2)
        width = x[left + 1] - x[left]
        u = (clipped - x[left]) / width
        # Hermite basis on [0, 1]
        value: FloatArray = (
            y[left] * (1 + 2 * u) * (1 - u) ** 2
            + slopes[left] * width * u * (1 - u) ** 2
            + y[left + 1] * u**2 * (3 - 2 * u)
            + slopes[left + 1] * width * u**2 * (u - 1)
        )
        return value


def monotone_slopes(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the slope at each knot that keeps a cubic between the knots monotone where the data are."""
    secant = np.diff(y) / np.diff(x)
    slopes = np.empty_like(y)
    slopes[0], slopes[-1] = secant[0], secant[-1]
    left, right = secant[:-1], secant[1:]
    w_left = 2 * np.diff(x)[1:] + np.diff(x)[:-1]
    w_right = np.diff(x)[1:] + 2 * np.diff(x)[:-1]
    rising_together = left * right > 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        harmonic = (w_left + w_right) / (w_left / left + w_right / right)
    slopes[1:-1] = np.where(rising_together, harmonic, 0.0)
    return slopes


@dataclass(frozen=True)
class CellModel:
    """One kind of cell at 25 degC: equilibrium, losses and heat, for the whole series element (all parallel cans).

    The overpotential at current i is
        ohmic_ohm i  +  2RT/F asinh(R_ct i F / 2RT)  +  sum of RC pairs  +  hysteresis,
    resistances grow as exp(E/R (1/T - 1/298.15 K)). The capacitances are constants: what a pair stores then does not
    depend on temperature, so that heat and energy balance exactly.
    """

    name: str
    capacity_ah: float
    ocv_v: Table  # mean of charge and discharge branches, at rest
    entropy_v_per_k: Table  # dOCV/dT
    ohmic_ohm: Table
    charge_transfer_ohm: Table  # slope of the asinh law at zero current; 0 switches the term off
    rc_ohm: tuple[Table, ...]
    rc_f: tuple[float, ...]
    ohmic_j_per_mol: float = 0.0
    charge_transfer_j_per_mol: float = 0.0
    rc_j_per_mol: float = 0.0
    hysteresis_v: float = 0.0  # half the gap between the branches
    hysteresis_soc: float = 0.02  # charge, as a part of capacity, that turns a branch over to 63 %
    coulombic_efficiency: float = 1.0  # efficiency of charging
    self_discharge_a: float = 0.0
    heat_capacity_j_per_k: float = 480.0

    def __post_init__(self) -> None:
        for name in ("capacity_ah", "hysteresis_soc", "coulombic_efficiency", "heat_capacity_j_per_k"):
            if not getattr(self, name) > 0.0:
                raise ParameterError(name, getattr(self, name), "must be positive")
        if len(self.rc_ohm) != len(self.rc_f) or not self.rc_f:
            raise ParameterError("rc_f", self.rc_f, "needs one capacitance per RC pair, at least one pair")
        if min(self.rc_f) <= 0.0 or min(min(table.value) for table in self.rc_ohm) <= 0.0:
            raise ParameterError("rc_ohm, rc_f", self.rc_f, "an RC pair without resistance or capacitance is none")

    def equilibrium(self) -> tuple[FloatArray, FloatArray]:
        """Return the (1203,) SOC points and voltages [V] of an even curve with its two ends, held flat outside them."""
        grid = self.soc_grid
        ocv_v = self.ocv_v.at(grid)
        return (
            np.concatenate(([EMPTY_SOC], grid, [OVERFULL_SOC])),
            np.concatenate(([0.0], ocv_v, [ocv_v[-1] + OVERFULL_RISE_V])),
        )

    @property
    def soc_grid(self) -> FloatArray:
        """(1201,) evenly spaced SOC points at which the fast tables are laid out."""
        return np.linspace(SOC_GRID_START, SOC_GRID_STOP, OCV_GRID_POINTS)


def warburg_ladder(total_ohm: Table, diffusion_s: float, pairs: int) -> tuple[tuple[Table, ...], tuple[float, ...]]:
    """Return RC pairs (resistances [ohm], capacitances [F]) that stand for diffusion through a layer of finite length.

    R tanh(sqrt(s tau)) / sqrt(s tau) is the sum over odd m of pairs with resistance 8R/(m pi)^2 and time constant
    4 tau/(m pi)^2: the first `pairs` of them are kept, the last takes the resistance of all that follow.
    The capacitances are those at half charge; time constants follow the resistance.
    """
    odd = 2.0 * np.arange(pairs) + 1.0
    share = 8.0 / (odd * np.pi) ** 2
    share[-1] += 1.0 - share.sum()
    tau_s = 4.0 * diffusion_s / (odd * np.pi) ** 2
    middle_ohm = float(total_ohm.at(np.array(0.5)))
    rc_ohm = tuple(Table(total_ohm.soc, tuple(float(r * part) for r in total_ohm.value)) for part in share)
    rc_f = tuple(float(t / (middle_ohm * part)) for t, part in zip(tau_s, share, strict=True))
    return rc_ohm, rc_f


def _per_module(milliohm_per_can: tuple[float, ...], cans: int = 10) -> tuple[float, ...]:
    return tuple(r * 1e-3 / cans for r in milliohm_per_can)


_DIFFUSION_SOC = (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
_DIFFUSION_OHM, _DIFFUSION_F = warburg_ladder(
    Table(_DIFFUSION_SOC, _per_module((100.0, 70.0, 46.0, 29.0, 20.0, 15.5, 12.8, 12.8, 13.2, 14.8, 19.0, 29.0))),
    diffusion_s=80.0,
    pairs=4,
)

# Ten Samsung INR18650-25R in parallel, without fuses and busbars. OCV: mean of the two branches of a public 25R fit,
# smoothed; beyond 0 and 100 % continued to where a real cell would go. Resistances: split so that 0.1 s gives about
# 16.5 mohm and 10 s about 22 mohm per can at half charge, rising below 20 % as the public 10 s pulses do.
SAMSUNG_25R_10P = CellModel(
    name="10 x Samsung INR18650-25R",
    capacity_ah=25.5,
    ocv_v=Table(
        (-0.1, -0.04, 0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1),
        (1.0, 2.05, 2.66, 3.02, 3.305, 3.407, 3.505, 3.594, 3.656, 3.743, 3.839, 3.927, 4.021, 4.091, 4.19, 4.34),
    ),
    entropy_v_per_k=Table((0.0, 0.2, 0.5, 0.8, 1.0), (-2.6e-4, -1.5e-4, -0.8e-4, -0.6e-4, -1.0e-4)),
    ohmic_ohm=Table((0.0, 0.1, 0.5, 1.0), _per_module((14.0, 13.4, 13.0, 13.0))),
    charge_transfer_ohm=Table(
        (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.9, 1.0), _per_module((18.0, 12.0, 8.0, 5.5, 4.2, 3.5, 3.5, 4.5))
    ),
    rc_ohm=_DIFFUSION_OHM,
    rc_f=_DIFFUSION_F,
    ohmic_j_per_mol=8.0e3,
    charge_transfer_j_per_mol=40.0e3,
    rc_j_per_mol=28.0e3,
    hysteresis_v=0.0135,
    hysteresis_soc=0.025,
    coulombic_efficiency=0.9995,
    self_discharge_a=0.0008,
    heat_capacity_j_per_k=480.0,
)
