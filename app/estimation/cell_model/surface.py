"""A cell in few numbers: diffusion as a SOC at the surface, Butler-Volmer kinetics, Arrhenius over temperature.

    z_s  = z - f_d sum_k d_k i_k                           SOC at the surface; i_k = current through a lag of tau_k
    v    = OCV(z_s) + dU/dT(z_s) (T - T_0) - f_0 R_0 i - f_r sum_k R_k i_k - e T/T_0 asinh(f_k i / (i_0 s(z_s)))
    s(z) = z^a (1 - z)^b / 0.5^(a + b) c(z)                exchange current over SOC, c a smooth correction
    f_x  = exp(E_x / R (1/T - 1/T_0)),  T_0 = 298.15 K     one energy each for f_0, f_k, f_d and f_r

`SurfaceModel.tables` turns the numbers into those of `CellModel`, which every filter and prediction reads.
Source: Bernardi and Go 2011 (lags of the surface concentration), Doyle, Fuller and Newman 1993 (kinetics).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from app.estimation.arrays import FloatArray
from app.estimation.errors import ModelError

KELVIN: Final = 273.15
GAS_CONSTANT: Final = 8.314462618  # J/(mol K)
REFERENCE_K: Final = 298.15
END_SOC: Final = 0.01  # nearer to empty or full the exchange current stays: its powers go to zero there
ENERGY_MAX_J_MOL: Final = 150e3
EXPONENT_MAX: Final = 3.0
_END_SOC: Final = np.array([0.0, 0.01, 0.02, 0.03, 0.04, 0.06, 0.08, 0.1, 0.125])  # where s(z) bends
TABLE_SOC: Final = np.concatenate((_END_SOC, np.arange(0.15, 0.851, 0.05), 1.0 - _END_SOC[::-1]))
TABLE_DEGC: Final = np.array([*np.arange(-30.0, 35.0, 5.0), 40.0, 50.0, 60.0])


class Lag(NamedTuple):
    """A first-order lag of the current: time constant [s], d [1/A] by which it lowers the surface SOC, R [ohm]."""

    tau_s: float
    soc_per_a: float
    r_ohm: float


@dataclass(frozen=True)
class SurfaceModel:
    """The numbers of a cell; energies in J/mol, all else at 25 degC.

    Attributes:
        r0_ohm: R_0.
        r0_j_mol: E_0.
        kinetics_v: e.
        kinetics_a: i_0 at half charge.
        kinetics_j_mol: E_k.
        low_exponent: a.
        high_exponent: b.
        diffusion_j_mol: E_d.
        lag_j_mol: E_r of the R_k.
        correction_soc: (m,) SOC at which the exchange current is corrected.
        correction: (m,) c there.
        entropy_soc: (n,) SOC at which the OCV's change with temperature is known.
        entropy_v_k: (n,) dU/dT there [V/K].
        entropy_degc: lowest and highest temperature at which it was seen; beyond them the OCV stays [degC].
        lags: in the order of the states.

    Raises:
        ModelError: a number is not finite or out of range.
    """

    r0_ohm: float
    r0_j_mol: float
    kinetics_v: float
    kinetics_a: float
    kinetics_j_mol: float
    low_exponent: float
    high_exponent: float
    diffusion_j_mol: float
    lag_j_mol: float
    lags: tuple[Lag, ...]
    correction_soc: tuple[float, ...] = (0.5,)
    correction: tuple[float, ...] = (1.0,)
    entropy_soc: tuple[float, ...] = (0.5,)
    entropy_v_k: tuple[float, ...] = (0.0,)
    entropy_degc: tuple[float, ...] = (25.0, 25.0)

    def __post_init__(self) -> None:
        for name in ("kinetics_v", "kinetics_a"):
            self._refuse(name, getattr(self, name) > 0.0, "has to be positive")
        self._refuse("r0_ohm", self.r0_ohm >= 0.0, "has to be positive or 0")
        for name in ("r0_j_mol", "kinetics_j_mol", "diffusion_j_mol", "lag_j_mol"):
            limit = f"has to lie within {ENERGY_MAX_J_MOL:g} J/mol"
            self._refuse(name, abs(getattr(self, name)) <= ENERGY_MAX_J_MOL, limit)
        for name in ("low_exponent", "high_exponent"):
            self._refuse(name, 0.0 <= getattr(self, name) <= EXPONENT_MAX, f"has to lie in 0..{EXPONENT_MAX:g}")
        for name, values in (("correction", self.correction), ("entropy_v_k", self.entropy_v_k)):
            soc = self.correction_soc if name == "correction" else self.entropy_soc
            fits = len(values) == len(soc) > 0 and bool(np.isfinite(values).all() and (np.diff(soc) > 0.0).all())
            self._refuse(name, fits, "needs one finite number for each of its SOC, which rise")
        self._refuse("entropy_degc", len(self.entropy_degc) == 2, "needs the lowest and the highest temperature")
        self._refuse("correction", min(self.correction) > 0.0, "has to be positive")
        for k, lag in enumerate(self.lags):
            right = lag.tau_s > 0.0 and lag.soc_per_a >= 0.0 and lag.r_ohm >= 0.0 and bool(np.isfinite(lag).all())
            self._refuse(f"lag[{k}]", right, "needs a positive tau_s, soc_per_a and r_ohm that are not negative")

    def _refuse(self, name: str, is_right: bool, reason: str) -> None:
        value = getattr(self, name, 0.0)
        if not is_right or (isinstance(value, float) and not np.isfinite(value)):
            raise ModelError(f"surface.{name}", reason)

    def exchange_share(self, soc: ArrayLike) -> FloatArray:
        """Return s(z), the exchange current over that at half charge."""
        z = np.clip(np.asarray(soc, dtype=np.float64), END_SOC, 1.0 - END_SOC)
        powers = (2.0 * z) ** self.low_exponent * (2.0 * (1.0 - z)) ** self.high_exponent
        return np.asarray(powers * np.exp(np.interp(z, self.correction_soc, np.log(self.correction))))

    def tables(self) -> dict[str, Any]:
        """Return what the numbers say at `TABLE_SOC` and `TABLE_DEGC`, by the names that `CellModel` has for them."""
        soc, degc = TABLE_SOC, TABLE_DEGC
        shape = degc.size, soc.size
        kelvin = (degc + KELVIN)[:, None]
        lags = np.array(self.lags, dtype=np.float64).reshape(-1, 3)
        diffusion = arrhenius(kelvin, self.diffusion_j_mol)[:, 0]
        entropy_v_k = np.interp(soc, self.entropy_soc, self.entropy_v_k)
        seen_k = np.clip(kelvin - KELVIN, self.entropy_degc[0], self.entropy_degc[1]) + KELVIN
        faster = arrhenius(kelvin, self.kinetics_j_mol)
        return {
            "soc_grid": soc,
            "temperature_grid_degc": degc,
            "r0_ohm": np.broadcast_to(self.r0_ohm * arrhenius(kelvin, self.r0_j_mol), shape),
            "r_ohm": np.array(
                [np.broadcast_to(r * arrhenius(kelvin, self.lag_j_mol), shape) for r in lags[:, 2]]
            ).reshape(-1, *shape),
            "tau_s": np.array([np.full(shape, tau) for tau in lags[:, 0]]).reshape(-1, *shape),
            "overpotential_v": np.broadcast_to(self.kinetics_v * kelvin / REFERENCE_K, shape),
            "reference_a": self.kinetics_a * self.exchange_share(soc) / faster,
            "surface_per_a": lags[:, 1, None] * diffusion,
            "ocv_shift_v": entropy_v_k * (seen_k - REFERENCE_K),
        }


def arrhenius(kelvin: FloatArray, energy_j_mol: float) -> FloatArray:
    """Return exp(E / R (1/T - 1/T_0)): 1 at 25 degC, above 1 in the cold."""
    return np.asarray(np.exp(energy_j_mol / GAS_CONSTANT * (1.0 / kelvin - 1.0 / REFERENCE_K)))


NUMBERS: Final = tuple(field.name for field in fields(SurfaceModel) if field.type == "float")
ROWS: Final = tuple(field.name for field in fields(SurfaceModel) if field.type == "tuple[float, ...]")
