"""The model of one cell that filters and predictions use: OCV, ohmic drop, kinetics, up to four first-order lags.

States are the SOC and the *current* through each lag, so the process is linear whatever the output does:

    z'   = z - dt eta i / (3600 Q)                    eta = coulombic efficiency on charge, 1 on discharge
    i_k' = a_k i_k + (1 - a_k) i,   a_k = exp(-dt / tau_k)            exact for a held current
    z_s  = z - sum d_k i_k                            SOC at the surface of the particles: diffusion
    v    = OCV(z_s, T) - R0 i - e asinh(i / i_ref) - sum R_k i_k + M h

An equivalent circuit of RC pairs is the same with d_k = 0 and one i_ref. R0, e, R_k and i_ref are tables over z_s and
temperature, d_k over temperature, all interpolated linearly. Current is positive on discharge.
Source: the notes STATE-SPACE (zero-order hold) and EKF-CDKF-2022 (currents as states); `surface.py` for d_k and i_ref.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.evidence import Evidence
from app.estimation.cell_model.ocv import OVERSHOOT, OcvCurve
from app.estimation.cell_model.surface import GAS_CONSTANT, KELVIN, SurfaceModel
from app.estimation.errors import ModelError

MAX_RC_PAIRS: Final = 4
SECONDS_PER_HOUR: Final = 3600.0
TEMPERATURE_DEGC: Final = (-60.0, 150.0)  # range of any working cell
VOLTAGE_MAX_V: Final = 10.0  # no single cell has more
LEAST_WH_PER_KG: Final = 5.0  # specific energy of any cell, a capacitor included
ACTIVATION_SIGMA_J_MOL: Final = 12e3  # between lithium-ion cells, of what the whole drop follows over temperature
EMPTY_ACTIVATION_J_MOL: Final = 30e3  # by which the cold makes a cell look empty early: diffusion in solids
SHIFT_MAX_V: Final = 0.3
ENTROPY_SIGMA_V_K: Final = 3e-4  # by which an OCV changes with temperature where nothing has shown it


@dataclass(frozen=True, slots=True)
class CellLimits:
    """Limits of the data sheet beyond the voltages; None where unknown."""

    temperature_min_degc: float | None = None
    temperature_max_degc: float | None = None
    discharge_max_a: float | None = None  # continuous
    charge_max_a: float | None = None

    def __post_init__(self) -> None:
        for name in ("temperature_min_degc", "temperature_max_degc"):
            value = getattr(self, name)
            if value is not None and not TEMPERATURE_DEGC[0] <= value <= TEMPERATURE_DEGC[1]:
                raise ModelError(f"limits.{name}", f"has to lie in {TEMPERATURE_DEGC[0]:g}..{TEMPERATURE_DEGC[1]:g}")
        for name in ("discharge_max_a", "charge_max_a"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0.0):
                raise ModelError(f"limits.{name}", "has to be finite and positive; charging counts as positive here")
        low, high = self.temperature_min_degc, self.temperature_max_degc
        if low is not None and high is not None and not low < high:
            raise ModelError("limits.temperature_min_degc", "has to lie below temperature_max_degc")


@dataclass(frozen=True, eq=False)
class CellModel:
    """Everything the filters know about a cell. Tables are (n_temperatures, n_soc), RC tables (n_rc, n_t, n_soc).

    Attributes:
        name: what the cell is called.
        source: where the numbers come from.
        capacity_ah: charge between SOC 1 and 0 [Ah].
        ocv: open-circuit voltage over SOC.
        soc_grid: (n_soc,) SOC of the table columns, rising.
        temperature_grid_degc: (n_t,) temperature of the table rows [degC], rising; one row holds everywhere.
        r0_ohm: ohmic resistance [ohm].
        r_ohm: RC resistances [ohm]; n_rc = 0 is a cell without memory.
        tau_s: RC time constants [s], positive.
        overpotential_v: factor e of the static asinh(i / overpotential_current_a) [V]; zeros switch it off.
        overpotential_current_a: the current i_ref of that term [A], where it is the same everywhere.
        reference_a: (n_t, n_soc) i_ref, twice the exchange current, where it is not [A]; None = the same everywhere.
        surface: the few numbers that all tables were made of; None where the file has tables.
        surface_per_a: (n_rc, n_t) d_k, by which a current through a lag lowers the SOC at the surface [1/A]; None = 0.
        hysteresis_v: half the gap M between charge and discharge OCV [V]; 0 switches the state off.
        hysteresis_rate: how fast the hysteresis state follows charge, per unit of SOC moved.
        coulombic_efficiency: share of the charging charge that is kept, 0..1.
        v_min_v, v_max_v: limits of the cell's voltage [V].
        v_nominal_v: voltage by which the maker counts energy [V]; None where unknown. Not used by any filter.
        mass_kg: of what the file describes, a cell or a module of them [kg]; None where unknown.
        evidence: what the identification rests on; None = not known.
        limits: the data sheet's other limits; no filter uses them.
        fit_voltage_rms_v: open-loop voltage error of the identification [V]; 0 = not known.
        fit_current_max_a: largest current magnitude the identification has seen [A]; 0 = not known.
        fit_temperature_degc: (m,) rising temperatures the identification has seen [degC]; None = those of the tables.
        activation_sigma_j_mol: how far the activation energy of the resistances may be off between and beyond these
            temperatures [J/mol].
        ocv_shift_v: (n_t, n_soc) by which the OCV at a temperature lies above the curve [V]; None = nowhere.

    Raises:
        ModelError: a shape does not match, a value is not finite or out of range.
    """

    name: str
    capacity_ah: float
    ocv: OcvCurve
    soc_grid: FloatArray
    temperature_grid_degc: FloatArray
    r0_ohm: FloatArray
    r_ohm: FloatArray
    tau_s: FloatArray
    overpotential_v: FloatArray | None = None
    overpotential_current_a: float = 1.0
    reference_a: FloatArray | None = None
    surface_per_a: FloatArray | None = None
    hysteresis_v: float = 0.0
    hysteresis_rate: float = 50.0
    coulombic_efficiency: float = 1.0
    v_min_v: float = 2.5
    v_max_v: float = 4.2
    v_nominal_v: float | None = None
    mass_kg: float | None = None
    fit_voltage_rms_v: float = 0.0
    fit_current_max_a: float = 0.0
    fit_temperature_degc: FloatArray | None = None
    activation_sigma_j_mol: float = ACTIVATION_SIGMA_J_MOL
    ocv_shift_v: FloatArray | None = None
    source: str = ""
    surface: SurfaceModel | None = None
    evidence: Evidence | None = None
    limits: CellLimits = CellLimits()
    _static: FloatArray = field(init=False, repr=False)
    _shift: FloatArray = field(init=False, repr=False)
    _measured_degc: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        for name in ("soc_grid", "temperature_grid_degc", "r0_ohm", "r_ohm", "tau_s"):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=np.float64))
        shape = (self.temperature_grid_degc.size, self.soc_grid.size)
        over = np.zeros(shape) if self.overpotential_v is None else np.array(self.overpotential_v, dtype=np.float64)
        object.__setattr__(self, "overpotential_v", over)
        for name in ("ocv_shift_v", "fit_temperature_degc", "reference_a", "surface_per_a"):
            given = getattr(self, name)
            object.__setattr__(self, name, None if given is None else np.array(given, dtype=np.float64))
        object.__setattr__(self, "_shift", np.zeros(shape) if self.ocv_shift_v is None else self.ocv_shift_v)
        measured = self.temperature_grid_degc if self.fit_temperature_degc is None else self.fit_temperature_degc
        object.__setattr__(self, "_measured_degc", measured)
        _check(self, shape)
        per_a = (
            np.full(shape, 1.0 / self.overpotential_current_a) if self.reference_a is None else 1.0 / self.reference_a
        )
        object.__setattr__(self, "_static", np.concatenate(([self.r0_ohm, over], self.r_ohm, self.tau_s, [per_a])))

    @property
    def n_rc(self) -> int:
        """Number of RC pairs."""
        return int(self.r_ohm.shape[0])

    @property
    def has_surface(self) -> bool:
        """Return whether the OCV is that of the surface's SOC, with an overpotential current of its own at each SOC."""
        return self.surface_per_a is not None

    @property
    def measured_degc(self) -> FloatArray:
        """(m,) rising temperatures that were measured; without a word about them those of the tables [degC]."""
        return self._measured_degc

    @property
    def c_rate_a(self) -> float:
        """The current that empties the cell in an hour [A]."""
        return self.capacity_ah

    @property
    def drop_per_c_v(self) -> float:
        """Voltage a lasting current takes for each C of it, at 3C, half charge and 25 degC [V]."""
        return float(self.lasting_ohm(25.0)) * self.c_rate_a

    def lasting_ohm(self, temperature_degc: ArrayLike) -> FloatArray:
        """Return the voltage a lasting current takes for each ampere of it, at 3C and half charge [ohm]."""
        i = 3.0 * self.c_rate_a
        degc = np.asarray(temperature_degc, dtype=np.float64)
        return self.drop_v(np.full(degc.shape, 0.5), np.full((self.n_rc, *degc.shape), i), i, degc) / i

    def parameters(self, soc: ArrayLike, temperature_degc: ArrayLike) -> FloatArray:
        """Return (2 + 2 n_rc, ...) rows R0, e, R_1.., tau_1.. at each SOC and temperature, broadcast together.

        Linear in both; held at the edge of the tables. In a model of the surface its SOC counts.
        """
        return self._rows_at(soc, temperature_degc)[:-1]

    def time_constants(self, soc: ArrayLike, temperature_degc: ArrayLike) -> FloatArray:
        """Return (n_rc, ...) tau_k [s] at each SOC and temperature, broadcast together."""
        return self._rows_at(soc, temperature_degc)[2 + self.n_rc : -1]

    def per_reference(self, soc: ArrayLike, temperature_degc: ArrayLike) -> FloatArray:
        """Return (...) 1 / i_ref [1/A] at each SOC and temperature, broadcast together."""
        return np.asarray(self._rows_at(soc, temperature_degc)[-1])

    def surface_soc(
        self, soc: ArrayLike, branch_a: ArrayLike, temperature_degc: ArrayLike, factor: ArrayLike = 1.0
    ) -> FloatArray:
        """Return z_s = z - factor sum d_k i_k; arguments as in `drop_v`."""
        z = np.asarray(soc, dtype=np.float64)
        if self.surface_per_a is None:
            return z
        below = np.zeros_like(z)
        for d, i_k in zip(self.surface_per_a, np.asarray(branch_a, dtype=np.float64), strict=True):
            below = (
                below + np.interp(np.asarray(temperature_degc, dtype=np.float64), self.temperature_grid_degc, d) * i_k
            )
        return np.asarray(z - np.asarray(factor, dtype=np.float64) * below)

    def drop_v(
        self,
        soc: ArrayLike,
        branch_a: ArrayLike,
        current_a: ArrayLike,
        temperature_degc: ArrayLike = 25.0,
        factor: ArrayLike = 1.0,
    ) -> FloatArray:
        """Return by how much a current lowers the voltage below the OCV of a SOC [V].

        OCV(z) - OCV(z_s) + factor (R0 i + e asinh(i / i_ref) + sum R_k i_k)

        Args:
            soc: (...) state of charge.
            branch_a: (n_rc, ...) currents through the lags [A].
            current_a: (...) or scalar, positive on discharge [A].
            temperature_degc: (...) or scalar [degC].
            factor: (...) or scalar, resistances of the cell, and its d_k, over those of the model.
        """
        i, branches = np.asarray(current_a, dtype=np.float64), np.asarray(branch_a, dtype=np.float64)
        scale = np.asarray(factor, dtype=np.float64)
        surface = self.surface_soc(soc, branches, temperature_degc, scale)
        p = self._rows_at(surface, temperature_degc)
        ohmic = p[0] * i + (p[2 : 2 + self.n_rc] * branches).sum(axis=0)
        drop = scale * (ohmic + p[1] * np.arcsinh(i * p[-1]))
        if self.has_surface:
            degc = temperature_degc
            drop = drop + self.open_circuit_voltage(soc, degc) - self.open_circuit_voltage(surface, degc)
        return np.asarray(drop)

    def _rows_at(self, soc: ArrayLike, temperature_degc: ArrayLike) -> FloatArray:
        """Return (3 + 2 n_rc, ...) rows R0, e, R_1.., tau_1.., 1 / i_ref."""
        js, ws = _weights(self.soc_grid, np.asarray(soc, dtype=np.float64))
        jt, wt = _weights(self.temperature_grid_degc, np.asarray(temperature_degc, dtype=np.float64))
        n_soc, n_t = self.soc_grid.size, self.temperature_grid_degc.size
        table = self._static.reshape(-1, n_t * n_soc)
        ks = np.minimum(js + 1, n_soc - 1)
        here, above = jt * n_soc, np.minimum(jt + 1, n_t - 1) * n_soc
        one_minus_ws = 1 - ws
        low = table.take(here + js, axis=1) * one_minus_ws + table.take(here + ks, axis=1) * ws
        high = table.take(above + js, axis=1) * one_minus_ws + table.take(above + ks, axis=1) * ws
        return np.asarray(low * (1 - wt) + high * wt)

    def open_circuit_voltage(self, soc: ArrayLike, temperature_degc: ArrayLike) -> FloatArray:
        """Return the OCV [V] at each SOC and temperature, broadcast together."""
        js, ws = _weights(self.soc_grid, np.asarray(soc, dtype=np.float64))
        jt, wt = _weights(self.temperature_grid_degc, np.asarray(temperature_degc, dtype=np.float64))
        ks, kt = np.minimum(js + 1, self.soc_grid.size - 1), np.minimum(jt + 1, self.temperature_grid_degc.size - 1)
        t = self._shift
        low, high = t[jt, js] * (1 - ws) + t[jt, ks] * ws, t[kt, js] * (1 - ws) + t[kt, ks] * ws
        return np.asarray(self.ocv.voltage(soc) + low * (1 - wt) + high * wt)

    def drop_error(self, temperature_degc: ArrayLike) -> FloatArray:
        """Return by what share the resistances may be off at each temperature for want of measurements.

        sigma_E / R |1/T - 1/T_m| beyond the measured temperatures T_m; between two of them the distances count as
        d1 d2 / (d1 + d2). Where nothing measured the OCV the share is 1.
        """
        if self.evidence is not None and not self.evidence.has_ocv:
            return np.ones(np.shape(temperature_degc))
        below, above = self._measured_around(1.0 / (np.asarray(temperature_degc, dtype=np.float64) + KELVIN))
        return np.asarray(self.activation_sigma_j_mol / GAS_CONSTANT * _bridge(below, above))

    def ocv_error_v(self, temperature_degc: ArrayLike) -> FloatArray:
        """Return how far the OCV may be off at each temperature for want of measurements [V]."""
        inverse = 1.0 / (np.asarray(temperature_degc, dtype=np.float64) + KELVIN)
        below, above = self._measured_around(inverse)
        return np.asarray(ENTROPY_SIGMA_V_K * _bridge(below, above) / inverse**2)

    def lowest_soc(self, temperature_degc: ArrayLike) -> FloatArray:
        """Return the lowest SOC that the identification has seen under load at each temperature, -1 where not known.

        Colder than the coldest test it grows as diffusion slows down.
        """
        degc = np.asarray(temperature_degc, dtype=np.float64)
        if self.evidence is None or not self.evidence.lowest:
            return np.full(degc.shape, -1.0)
        seen_degc, seen_soc = np.array(self.evidence.lowest).T
        colder = np.maximum(1.0 / (degc + KELVIN) - 1.0 / (seen_degc[0] + KELVIN), 0.0)
        grown = np.exp(EMPTY_ACTIVATION_J_MOL / GAS_CONSTANT * colder)
        return np.asarray(np.minimum(np.interp(degc, seen_degc, seen_soc) * grown, 1.0))

    def _measured_around(self, inverse_k: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return how far in 1/K the next warmer and the next colder measured temperature are, infinite without."""
        apart = 1.0 / (self._measured_degc + KELVIN) - inverse_k[..., None]
        with np.errstate(invalid="ignore"):
            warmer = np.where(apart <= 0.0, -apart, np.inf).min(axis=-1)
            colder = np.where(apart >= 0.0, apart, np.inf).min(axis=-1)
        return warmer, colder

    def terminal_voltage(
        self,
        soc: ArrayLike,
        branch_a: ArrayLike,
        current_a: ArrayLike,
        temperature_degc: ArrayLike = 25.0,
        hysteresis: ArrayLike = 0.0,
    ) -> FloatArray:
        """Return the terminal voltage [V], same shape as `soc`.

        Args:
            soc: (...) state of charge.
            branch_a: (n_rc, ...) currents through the lags [A].
            current_a: (...) or scalar, positive on discharge [A].
            temperature_degc: (...) or scalar [degC].
            hysteresis: (...) or scalar, -1 after a long discharge to +1 after a long charge.
        """
        rested_v = self.open_circuit_voltage(soc, temperature_degc) + self.hysteresis_v * np.asarray(hysteresis)
        return np.asarray(rested_v - self.drop_v(soc, branch_a, current_a, temperature_degc))


def charge_moved_coulomb(model: CellModel, current_a: ArrayLike, dt_s: ArrayLike) -> FloatArray:
    """Return the charge taken out of the cell [C] by a held current; charging counts times the efficiency."""
    i = np.asarray(current_a, dtype=np.float64)
    return np.asarray(np.where(i < 0, model.coulombic_efficiency * i, i) * np.asarray(dt_s))


def _weights(grid: FloatArray, x: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
    if grid.size == 1:
        return np.zeros(x.shape, dtype=np.intp), np.zeros(x.shape)
    j = np.minimum(np.maximum(grid.searchsorted(x, side="right") - 1, 0), grid.size - 2)
    start = grid.take(j)
    return j, np.minimum(np.maximum((x - start) / (grid.take(j + 1) - start), 0.0), 1.0)


def _bridge(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return left right / (left + right), which is the other one where one is infinite."""
    least, most = np.minimum(left, right), np.maximum(left, right)
    return np.asarray(least / (1.0 + least / np.where(most > 0.0, most, 1.0)))


def _check(model: CellModel, shape: tuple[int, int]) -> None:
    for name in ("soc_grid", "temperature_grid_degc"):
        grid = getattr(model, name)
        if grid.ndim != 1 or grid.size < 1 or not np.isfinite(grid).all() or not (np.diff(grid) > 0).all():
            raise ModelError(name, "has to be one rising row of finite numbers")
    if model.soc_grid[0] < -OVERSHOOT or model.soc_grid[-1] > 1.0 + OVERSHOOT:
        raise ModelError("soc_grid", "has to lie inside -0.05..1.05: 1 is full")
    low, high = TEMPERATURE_DEGC
    if model.temperature_grid_degc[0] < low or model.temperature_grid_degc[-1] > high:
        raise ModelError("temperature_grid_degc", f"has to lie in {low:g}..{high:g}")
    for name in ("r0_ohm", "overpotential_v"):
        table = getattr(model, name)
        if table.shape != shape:
            raise ModelError(name, f"has shape {table.shape}, the grids ask for {shape}")
        if not (np.isfinite(table).all() and (table >= 0).all()):
            raise ModelError(name, "has to be finite and not negative")
    if (model.reference_a is None) != (model.surface_per_a is None):
        raise ModelError("reference_a", "and surface_per_a are given together")
    if model.reference_a is not None and model.surface_per_a is not None:
        if model.reference_a.shape != shape or not (np.isfinite(model.reference_a) & (model.reference_a > 0)).all():
            raise ModelError("reference_a", f"has to be a table of {shape}, finite and positive")
        of_lags = (model.r_ohm.shape[0], shape[0])
        if (
            model.surface_per_a.shape != of_lags
            or not (np.isfinite(model.surface_per_a) & (model.surface_per_a >= 0)).all()
        ):
            raise ModelError("surface_per_a", f"has to be a table of {of_lags}, finite and not negative")
    if model._shift.shape != shape:
        raise ModelError("ocv_shift_v", f"has shape {model._shift.shape}, the grids ask for {shape}")
    if not (np.abs(model._shift) <= SHIFT_MAX_V).all():
        raise ModelError(
            "ocv_shift_v", f"has to be finite and within {SHIFT_MAX_V:g} V: what temperature does to an OCV"
        )
    seen = model._measured_degc
    if seen.ndim != 1 or seen.size < 1 or not np.isfinite(seen).all() or not (np.diff(seen) > 0).all():
        raise ModelError("fit_temperature_degc", "has to be one rising row of finite numbers")
    n_rc = model.r_ohm.shape[0] if model.r_ohm.ndim == 3 else -1
    if not 0 <= n_rc <= MAX_RC_PAIRS or model.r_ohm.shape[1:] != shape or model.tau_s.shape != model.r_ohm.shape:
        raise ModelError(
            "r_ohm",
            f"needs 0 to {MAX_RC_PAIRS} tables of {shape}, and tau_s alike: {model.r_ohm.shape}, {model.tau_s.shape}",
        )
    for k, (r_ohm, tau_s) in enumerate(zip(model.r_ohm, model.tau_s, strict=True)):
        if not (np.isfinite(r_ohm).all() and (r_ohm >= 0).all()):
            raise ModelError(f"r_ohm[{k}]", "has to be finite and not negative")
        if not (np.isfinite(tau_s).all() and (tau_s > 0).all()):
            raise ModelError(f"tau_s[{k}]", "has to be finite and positive")
    for name in ("capacity_ah", "overpotential_current_a", "hysteresis_rate"):
        if not (np.isfinite(getattr(model, name)) and getattr(model, name) > 0):
            raise ModelError(name, "has to be finite and positive")
    for name in ("hysteresis_v", "fit_voltage_rms_v", "fit_current_max_a", "activation_sigma_j_mol"):
        if not (np.isfinite(getattr(model, name)) and getattr(model, name) >= 0):
            raise ModelError(name, "has to be finite and not negative")
    if not 0.5 <= model.coulombic_efficiency <= 1.0:
        raise ModelError("coulombic_efficiency", "has to lie in 0.5..1")
    for name in ("v_min_v", "v_max_v"):
        if not 0.0 <= getattr(model, name) <= VOLTAGE_MAX_V:
            raise ModelError(name, f"has to lie in 0..{VOLTAGE_MAX_V:g} V, the volts of one cell")
    if not model.v_min_v < model.v_max_v:
        raise ModelError("v_min_v", "has to lie below v_max_v")
    if model.v_nominal_v is not None and not model.v_min_v <= model.v_nominal_v <= model.v_max_v:
        raise ModelError("v_nominal_v", "has to lie in v_min_v..v_max_v")
    if model.mass_kg is not None:
        if not (np.isfinite(model.mass_kg) and model.mass_kg > 0.0):
            raise ModelError("mass_kg", "has to be finite and positive")
        if model.capacity_ah * model.v_max_v / model.mass_kg < LEAST_WH_PER_KG:
            raise ModelError("mass_kg", f"would be less than {LEAST_WH_PER_KG:g} Wh/kg: is it in grams?")
    if model.ocv.voltage_v[0] < 0.0 or model.ocv.voltage_v[-1] > VOLTAGE_MAX_V:
        raise ModelError("ocv", f"has to lie in 0..{VOLTAGE_MAX_V:g} V, the volts of one cell")
    if float(model.r0_ohm.min()) * model.capacity_ah > model.v_max_v - model.v_min_v:
        raise ModelError("r0_ohm", "would take all of the voltage at 1C: is it in milliohms?")
