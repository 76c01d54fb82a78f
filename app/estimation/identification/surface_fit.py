"""The numbers of a `SurfaceModel`, and the OCV, that explain recordings best: one least-squares problem over all.

Unknown are those of `surface.py`, with positive ones as logarithms, currents in C; and of the OCV its place between the
slow branches, an offset over SOC and a change with temperature. Every one has a prior, so what no recording shows stays
what cells usually are. Solved by Levenberg and Marquardt's steps with exact slopes; rows
far off count less (Huber), and each recording counts by what is left of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.surface import (
    END_SOC,
    ENERGY_MAX_J_MOL,
    EXPONENT_MAX,
    GAS_CONSTANT,
    KELVIN,
    REFERENCE_K,
    Lag,
    SurfaceModel,
)
from app.estimation.identification.parts import REST_CURRENT_C, Part, current_between, has_soc_column
from app.estimation.identification.slow_tests import SlowCurves
from app.estimation.identification.solvers import first_order

REFERENCE_DEGC: Final = REFERENCE_K - KELVIN
SOC_GRID: Final = np.linspace(-0.1, 1.1, 1201)
SOC_STEP: Final = 0.001
OFFSET_SOC: Final = np.linspace(0.0, 1.0, 11)
ENTROPY_SOC: Final = np.array([0.0, 0.5, 1.0])
CORRECTION_SOC: Final = np.array([0.05, 0.25, 0.5, 0.75, 1.0])
LAG_S: Final = ((), (60.0,), (25.0, 300.0), (5.0, 40.0, 800.0), (3.0, 20.0, 120.0, 1000.0))  # by how many there are

# priors: mean and sigma, of logarithms where the number is positive, currents in C, resistances in V for 1C
OHMIC_SHARE: Final = 0.7  # R_0, of the resistance that steps of the current show
OHMIC_SIGMA: Final = 0.7
OHMIC_J_MOL: Final = (18e3, 5e3)
KINETICS_V: Final = (0.05, 0.15)  # 2 R T / F
KINETICS_C: Final = (1.0, 1.2)
KINETICS_J_MOL: Final = (35e3, 6e3)
EXPONENT: Final = (0.5, 0.1)
DIFFUSION_J_MOL: Final = (27e3, 5e3)
LAG_J_MOL: Final = (27e3, 8e3)
LAG_SIGMA: Final = 0.25  # sigma of its time constant: what is slower would stand for OCV and capacity
SURFACE_PER_C: Final = ((0.01, 1.0), (0.03, 0.5))  # surface terms of the lags, the slowest last
NO_SURFACE: Final = (1e-9, 1e-3)  # surface terms of an equivalent circuit
LAG_V_PER_C: Final = ((0.02, 1.0), (0.006, 0.5))
CORRECTION_SIGMA: Final = 0.3
CORRECTION_BEND: Final = 0.15
BLEND: Final = (0.5, 0.25)
OFFSET_SIGMA_V: Final = 0.001  # the two slow branches bracket the OCV ...
OFFSET_SIGMA_ALONE_V: Final = 0.01  # ... a discharge alone does not
ENTROPY_V_K: Final = 3e-4
BOUND_SIGMAS: Final = 5.0  # no number goes farther from its prior

VOLTAGE_SIGMA_V: Final = 0.01  # what is left of a recording, before it is known ...
LEAST_SIGMA_V: Final = 0.003  # ... and at least
PART_WEIGHT: Final = 30.0  # independent samples that each recording counts for
DRIVE_WEIGHT: Final = 3.0  # weight of a drive: the model is for the currents of drives
LAID_WEIGHT: Final = 0.3  # weight of a recording without a soc column: its SOC, laid on its rests, is less sure
BLOCK_S: Final = 30.0
BLOCK_WEIGHT: Final = 3.0
STEP_LIMIT_S: Final = 1.0  # a sample counts for the time it stands for, up to this
RECENT_S: Final = 120.0  # after so long without current ...
REST_WEIGHT: Final = 0.1  # ... a resting sample says little new
ROWS_LIMIT: Final = 1500
ROUNDS: Final = 4  # number of rounds of weights
STEPS: Final = 25  # steps of each round
DONE: Final = 1e-4  # share of the cost: a smaller gain ends a round
TAU_STEP: Final = 0.35  # step of ln tau between computed time constants
ALIKE_K: Final = 5.0  # recordings at temperatures so near have a like error


def hat_weights(knots: FloatArray, x: FloatArray) -> FloatArray:
    """Return (n, n_knots) weights of linear interpolation at x, held at the ends; every row sums to 1."""
    j = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, knots.size - 2)
    share = np.clip((x - knots[j]) / (knots[j + 1] - knots[j]), 0.0, 1.0)
    weights = np.zeros((x.size, knots.size))
    rows = np.arange(x.size)
    weights[rows, j] = 1.0 - share
    weights[rows, j + 1] = share
    return weights


def branch_current(time_s: FloatArray, current_a: FloatArray, tau_s: float) -> FloatArray:
    """Return the (n,) current through a lag [A], from rest, driven by the mean of neighbouring samples."""
    decay = np.exp(-np.diff(time_s, prepend=time_s[:1]) / tau_s)
    return first_order(decay, (1.0 - decay) * current_between(time_s, current_a))


class Unknowns:
    """Names, priors and places of the unknowns; `x` holds their values everywhere."""

    def __init__(self, slow: SlowCurves, typical_v: float, n_lags: int, has_surface: bool = True) -> None:
        """Begin.

        Args:
            slow: branches that the OCV lies between.
            typical_v: voltage that steps of 1C show.
            n_lags: first-order lags, 0..4.
            has_surface: False for an equivalent circuit, whose lags are RC pairs alone.
        """
        rows: list[tuple[str, int, float, float]] = [
            ("ohmic", 1, float(np.log(OHMIC_SHARE * typical_v)), OHMIC_SIGMA),
            ("ohmic_energy", 1, *OHMIC_J_MOL),
            ("e", 1, float(np.log(KINETICS_V[0])), KINETICS_V[1]),
            ("i0", 1, float(np.log(KINETICS_C[0])), KINETICS_C[1]),
            ("kinetics_energy", 1, *KINETICS_J_MOL),
            ("low", 1, *EXPONENT),
            ("high", 1, *EXPONENT),
            ("diffusion_energy", 1, *DIFFUSION_J_MOL),
            ("lag_energy", 1, *LAG_J_MOL),
        ]
        for k, tau_s in enumerate(LAG_S[n_lags]):
            is_slow = k == n_lags - 1 and n_lags > 1
            rows.append((f"tau{k}", 1, float(np.log(tau_s)), LAG_SIGMA))
            surface = SURFACE_PER_C[is_slow] if has_surface else NO_SURFACE
            for short, (at, width) in (("d", surface), ("r", LAG_V_PER_C[is_slow and has_surface])):
                rows.append((f"{short}{k}", 1, float(np.log(at)), width))
        offset_v = OFFSET_SIGMA_V if slow.has_charge else OFFSET_SIGMA_ALONE_V
        rows += [
            ("correction", CORRECTION_SOC.size, 0.0, CORRECTION_SIGMA),
            ("offset", OFFSET_SOC.size, 0.0, offset_v),
            ("entropy", ENTROPY_SOC.size, 0.0, ENTROPY_V_K),
            ("blend", 2, *BLEND),
        ]
        self.n_lags = n_lags
        self.places: dict[str, slice] = {}
        mean: list[float] = []
        sigma: list[float] = []
        for name, n, at, width in rows:
            self.places[name] = slice(len(mean), len(mean) + n)
            mean += [at] * n
            sigma += [width] * n
        self.mean, self.sigma = np.array(mean), np.array(sigma)
        #: (n, n) inverse covariance of the priors: values, and how far neighbours over SOC bend
        self.precision = np.diag(self.sigma**-2.0)
        for name, bend in (("correction", CORRECTION_BEND), ("offset", offset_v)):
            place = self.places[name]
            second = np.diff(np.eye(place.stop - place.start), 2, axis=0) / bend
            self.precision[place, place] += second.T @ second

    def bounded(self, x: FloatArray) -> FloatArray:
        """Return the values within `BOUND_SIGMAS` of their priors, and where a cell model takes them."""
        x = np.clip(x, self.mean - BOUND_SIGMAS * self.sigma, self.mean + BOUND_SIGMAS * self.sigma)
        for name, (low, high) in {"low": (0.0, EXPONENT_MAX), "high": (0.0, EXPONENT_MAX)}.items():
            x[self.places[name]] = np.clip(x[self.places[name]], low, high)
        for name in (place for place in self.places if place.endswith("_energy")):
            x[self.places[name]] = np.clip(x[self.places[name]], 0.0, ENERGY_MAX_J_MOL)
        return x

    def of(self, x: FloatArray, name: str) -> float:
        """Return one value."""
        return float(x[self.places[name]][0])


class OcvBasis:
    """Basis functions of the OCV on `SOC_GRID`; straight beyond full and empty."""

    def __init__(self, slow: SlowCurves) -> None:
        inside = np.clip(SOC_GRID, 0.0, 1.0)
        low = (slow.discharge_v[4] - slow.discharge_v[0]) / slow.soc[4]
        high = (slow.charge_v[-1] - slow.charge_v[-5]) / (1.0 - slow.soc[-5])
        self.discharge_v = np.interp(inside, slow.soc, slow.discharge_v)
        self.discharge_v += np.minimum(SOC_GRID, 0.0) * np.clip(low, 0.02, 5.0)
        self.discharge_v += np.maximum(SOC_GRID - 1.0, 0.0) * np.clip(high, 0.02, 5.0)
        gap_v = np.interp(inside, slow.soc, slow.charge_v - slow.discharge_v)
        self.gap_v = np.array([gap_v * (1.0 - inside), gap_v * inside])
        self.offset = hat_weights(OFFSET_SOC, inside).T
        self.entropy = hat_weights(ENTROPY_SOC, inside).T

    def ocv_v(self, unknowns: Unknowns, x: FloatArray) -> FloatArray:
        """Return (n,) the OCV at 25 degC [V]."""
        places = unknowns.places
        return np.asarray(self.discharge_v + x[places["blend"]] @ self.gap_v + x[places["offset"]] @ self.offset)


class Rows:
    """The rows of a part that are fitted: SOC, current [C], temperature, voltage, weights, and means over `BLOCK_S`."""

    def __init__(self, part: Part, slow: SlowCurves, capacity_ah: float) -> None:
        r = part.recording
        weight = _row_weights(part, slow, capacity_ah)
        used = np.flatnonzero(weight > 0.0)
        self.rows = used[:: max(-(-used.size // ROWS_LIMIT), 1)]
        self.weight = weight[self.rows] / max(float(weight[self.rows].sum()), 1e-300)
        self.weight *= (
            PART_WEIGHT * (1.0 if has_soc_column(r) else LAID_WEIGHT) * (DRIVE_WEIGHT if part.is_drive else 1.0)
        )
        self.soc, self.voltage_v = part.soc[self.rows], r.voltage_v[self.rows]
        self.current_c = r.current_a[self.rows] / capacity_ah
        degc = r.temperature_degc[self.rows]
        self.kelvin = np.where(np.isnan(degc), REFERENCE_DEGC, degc) + KELVIN
        self.degc = float(np.median(self.kelvin)) - KELVIN if self.rows.size else REFERENCE_DEGC
        self.sigma_v, self.trust = VOLTAGE_SIGMA_V, np.ones(self.rows.size)
        block = np.floor((r.time_s[self.rows] - r.time_s[0]) / BLOCK_S)
        self.blocks = np.flatnonzero(np.diff(block, prepend=-1.0))
        self._step_s = np.diff(r.time_s, prepend=r.time_s[:1])
        self._between_c = current_between(r.time_s, r.current_a) / capacity_ah
        self._lags: dict[int, FloatArray] = {}

    def lag(self, log_tau: float) -> tuple[FloatArray, FloatArray]:
        """Return (rows,) the current through a lag of that ln tau [C] and its derivative with ln tau.

        By the cubic through four time constants of a grid: computing one takes as long as all else.
        """
        at = log_tau / TAU_STEP
        first = int(np.floor(at)) - 1
        u = at - first
        four = np.array([self._on_grid(first + k) for k in range(4)])
        others = [[j for j in range(4) if j != k] for k in range(4)]
        per = [float(np.prod([k - j for j in rest])) for k, rest in enumerate(others)]
        value = [(u - a) * (u - b) * (u - c) for a, b, c in others]
        slope = [(u - a) * (u - b) + (u - a) * (u - c) + (u - b) * (u - c) for a, b, c in others]
        return np.divide(value, per) @ four, np.divide(slope, per) @ four / TAU_STEP

    def _on_grid(self, k: int) -> FloatArray:
        if k not in self._lags:
            decay = np.exp(-self._step_s / np.exp(k * TAU_STEP))
            self._lags[k] = first_order(decay, (1.0 - decay) * self._between_c)[self.rows]
        return self._lags[k]

    def weigh(self, left_v: FloatArray) -> float:
        """Count rows that are far off less; return the RMS of what is left [V]."""
        size = np.abs(left_v)
        limit = 3.0 * float(np.median(size))
        self.trust = np.minimum(1.0, limit / np.maximum(size, 1e-9))
        return float(np.sqrt(np.average(left_v**2, weights=self.weight * self.trust)))


def voltage_and_slopes(unknowns: Unknowns, basis: OcvBasis, rows: Rows, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return (n,) voltages of the model [V] and (n, n_unknowns) their slopes; the equations are in `surface.py`."""
    at, of = unknowns.places, unknowns.of
    i, T, inverse = rows.current_c, rows.kelvin, (1.0 / rows.kelvin - 1.0 / REFERENCE_K) / GAS_CONSTANT
    f_0, f_k = np.exp(of(x, "ohmic_energy") * inverse), np.exp(of(x, "kinetics_energy") * inverse)
    f_d, f_r = np.exp(of(x, "diffusion_energy") * inverse), np.exp(of(x, "lag_energy") * inverse)
    lags = [rows.lag(of(x, f"tau{k}")) for k in range(unknowns.n_lags)]
    d = [float(np.exp(of(x, f"d{k}"))) for k in range(unknowns.n_lags)]
    r = [float(np.exp(of(x, f"r{k}"))) for k in range(unknowns.n_lags)]
    below, lagged_v = np.zeros(i.size), np.zeros(i.size)
    for k, (i_k, _) in enumerate(lags):
        below += d[k] * i_k
        lagged_v += r[k] * i_k
    z_s = np.clip(rows.soc - f_d * below, SOC_GRID[0], SOC_GRID[-1])
    place = (z_s - SOC_GRID[0]) / SOC_STEP
    j = np.clip(place.astype(np.intp), 0, SOC_GRID.size - 2)
    w = place - j
    ocv_v, entropy = basis.ocv_v(unknowns, x), x[at["entropy"]] @ basis.entropy
    z = np.clip(z_s, END_SOC, 1.0 - END_SOC)
    inside = (z_s > END_SOC) & (z_s < 1.0 - END_SOC)
    log_z, log_rest = np.log(2.0 * z), np.log(2.0 * (1.0 - z))
    hats = hat_weights(CORRECTION_SOC, z)
    log_s = of(x, "low") * log_z + of(x, "high") * log_rest + hats @ x[at["correction"]]
    over = i * f_k * np.exp(-of(x, "i0") - log_s)
    e = np.exp(of(x, "e")) * T / REFERENCE_K
    kinetics_v, bent_v = e * np.arcsinh(over), e * over / np.sqrt(1.0 + over**2)
    ohmic_v = np.exp(of(x, "ohmic")) * f_0 * i
    dT = T - REFERENCE_K
    v = ocv_v[j] + w * (ocv_v[j + 1] - ocv_v[j]) + (entropy[j] + w * (entropy[j + 1] - entropy[j])) * dT
    v = v - ohmic_v - f_r * lagged_v - kinetics_v
    slopes = np.zeros((i.size, x.size))

    def put(name: str, values: FloatArray) -> None:
        slopes[:, at[name]] = values.reshape(i.size, -1)

    correction_slope = np.append(np.diff(x[at["correction"]]) / np.diff(CORRECTION_SOC), 0.0)
    bend = correction_slope[np.clip(np.searchsorted(CORRECTION_SOC, z, side="right") - 1, -1, None)]
    bend = np.where((z >= CORRECTION_SOC[0]) & (z < CORRECTION_SOC[-1]), bend, 0.0)
    steep_v = (ocv_v[j + 1] - ocv_v[j] + (entropy[j + 1] - entropy[j]) * dT) / SOC_STEP
    steep_v = steep_v + np.where(inside, bent_v * (of(x, "low") / z - of(x, "high") / (1.0 - z) + bend), 0.0)
    put("ohmic", -ohmic_v)
    put("ohmic_energy", -ohmic_v * inverse)
    put("e", -kinetics_v)
    put("i0", bent_v)
    put("kinetics_energy", -bent_v * inverse)
    put("low", bent_v * log_z)
    put("high", bent_v * log_rest)
    put("correction", bent_v[:, None] * hats)
    put("diffusion_energy", -steep_v * f_d * below * inverse)
    put("lag_energy", -f_r * lagged_v * inverse)
    for k, (i_k, by_tau) in enumerate(lags):
        by_d, by_r = -steep_v * f_d * d[k], -f_r * r[k]
        put(f"d{k}", by_d * i_k)
        put(f"r{k}", by_r * i_k)
        put(f"tau{k}", (by_d + by_r) * by_tau)
    z = np.clip(z_s, 0.0, 1.0)
    put("offset", hat_weights(OFFSET_SOC, z))
    put("entropy", dT[:, None] * hat_weights(ENTROPY_SOC, z))
    put("blend", (basis.gap_v[:, j] + w * (basis.gap_v[:, j + 1] - basis.gap_v[:, j])).T)
    return v, slopes


@dataclass(frozen=True)
class SurfaceFit:
    """The best fit.

    Attributes:
        surface: the numbers of the cell.
        ocv_v: (n,) OCV at `SOC_GRID` [V], at 25 degC.
        sigma: of each unknown, by name; a row over SOC has the largest of its own.
        learned: by name, sigma over that of the prior: 1 = the recordings show nothing of it.
    """

    surface: SurfaceModel
    ocv_v: FloatArray
    sigma: dict[str, float]
    learned: dict[str, float]


def fit_surface(
    parts: Sequence[Part],
    slow: SlowCurves,
    capacity_ah: float,
    typical_ohm: float,
    n_lags: int,
    report_round: Callable[[], None] = lambda: None,
    has_surface: bool = True,
) -> SurfaceFit:
    """Return the numbers that explain all parts best; `report_round` is called after each of `ROUNDS`."""
    unknowns, basis = Unknowns(slow, typical_ohm * capacity_ah, n_lags, has_surface), OcvBasis(slow)
    rows = [Rows(part, slow, capacity_ah) for part in parts]
    degc = np.array([row.degc for row in rows])
    x = unknowns.mean.copy()
    for _ in range(ROUNDS):
        x, gram, left = _least(unknowns, basis, rows, x)
        rms_v = np.array([row.weigh(left_v) for row, left_v in zip(rows, left, strict=True)])
        for row in rows:
            alike = np.exp(-0.5 * ((degc - row.degc) / ALIKE_K) ** 2)
            row.sigma_v = max(float(np.sqrt(np.average(rms_v**2, weights=alike))), LEAST_SIGMA_V)
        report_round()
    sigma = np.sqrt(np.diag(np.linalg.inv(gram)))
    seen_degc = np.concatenate([row.kelvin for row in rows]) - KELVIN
    seen = (float(np.percentile(seen_degc, 1.0)), float(np.percentile(seen_degc, 99.0)))
    names = unknowns.places
    return SurfaceFit(
        surface=_surface(unknowns, x, capacity_ah, seen),
        ocv_v=basis.ocv_v(unknowns, x),
        sigma={name: float(sigma[place].max()) for name, place in names.items()},
        learned={name: float((sigma[place] / unknowns.sigma[place]).max()) for name, place in names.items()},
    )


def _least(
    unknowns: Unknowns, basis: OcvBasis, rows: Sequence[Rows], x: FloatArray
) -> tuple[FloatArray, FloatArray, list[FloatArray]]:
    """Return the values of least cost at the present weights, the gram matrix there, and what is left of each part."""
    cost, gram, moment, left = _equations(unknowns, basis, rows, x)
    damping = 1e-2
    for _ in range(STEPS):
        step = np.linalg.solve(gram + damping * np.diag(np.diag(gram)), moment)
        tried = unknowns.bounded(x + np.clip(step, -2.0 * unknowns.sigma, 2.0 * unknowns.sigma))
        equations = _equations(unknowns, basis, rows, tried)
        if equations[0] >= cost:
            damping *= 6.0
            if damping > 1e6:
                break
            continue
        is_done = cost - equations[0] < DONE * cost
        x, (cost, gram, moment, left) = tried, equations
        damping = max(damping / 5.0, 1e-6)
        if is_done:
            break
    return x, gram, left


def _equations(
    unknowns: Unknowns, basis: OcvBasis, rows: Sequence[Rows], x: FloatArray
) -> tuple[float, FloatArray, FloatArray, list[FloatArray]]:
    """Return cost, gram matrix and moment of priors, samples and block means at x, and what is left [V]."""
    off = unknowns.mean - x
    gram, moment = unknowns.precision.copy(), unknowns.precision @ off
    cost, left = float(off @ moment), []
    for row in rows:
        v, A = voltage_and_slopes(unknowns, basis, row, x)
        left_v = row.voltage_v - v
        weight = row.weight * row.trust / row.sigma_v**2
        total = np.maximum(np.add.reduceat(weight, row.blocks), 1e-300)
        weighted = A * weight[:, None]
        mean_v = np.add.reduceat(left_v * weight, row.blocks) / total
        mean_A = np.add.reduceat(weighted, row.blocks, axis=0) / total[:, None]
        block = BLOCK_WEIGHT * total
        gram += weighted.T @ A + (mean_A * block[:, None]).T @ mean_A
        moment += weighted.T @ left_v + mean_A.T @ (block * mean_v)
        cost += float(weight @ left_v**2 + block @ mean_v**2)
        left.append(left_v)
    return cost, gram, moment, left


def _surface(unknowns: Unknowns, x: FloatArray, capacity_ah: float, seen_degc: tuple[float, float]) -> SurfaceModel:
    def of(name: str) -> float:
        return unknowns.of(x, name)

    lags = tuple(
        Lag(
            *(
                float(np.exp(of(f"{name}{k}"))) / per
                for name, per in (("tau", 1.0), ("d", capacity_ah), ("r", capacity_ah))
            )
        )
        for k in range(unknowns.n_lags)
    )
    return SurfaceModel(
        r0_ohm=float(np.exp(of("ohmic"))) / capacity_ah,
        r0_j_mol=of("ohmic_energy"),
        kinetics_v=float(np.exp(of("e"))),
        kinetics_a=float(np.exp(of("i0"))) * capacity_ah,
        kinetics_j_mol=of("kinetics_energy"),
        low_exponent=of("low"),
        high_exponent=of("high"),
        diffusion_j_mol=of("diffusion_energy"),
        lag_j_mol=of("lag_energy"),
        lags=lags,
        correction_soc=tuple(CORRECTION_SOC.tolist()),
        correction=tuple(np.exp(x[unknowns.places["correction"]]).tolist()),
        entropy_soc=tuple(ENTROPY_SOC.tolist()),
        entropy_v_k=tuple(x[unknowns.places["entropy"]].tolist()),
        entropy_degc=seen_degc,
    )


def _row_weights(part: Part, slow: SlowCurves, capacity_ah: float) -> FloatArray:
    """Return (n,) weights: time, less in long rests, less where the OCV is steep and a volt means little charge."""
    r = part.recording
    weight = np.minimum(r.step_s, STEP_LIMIT_S)
    busy = np.abs(r.current_a) > REST_CURRENT_C * capacity_ah
    last = np.maximum.accumulate(np.where(busy, np.arange(busy.size), -1))
    since_s = np.where(last >= 0, r.time_s - r.time_s[np.maximum(last, 0)], np.inf)
    weight = weight * np.where(since_s < RECENT_S, 1.0, REST_WEIGHT)
    slope = np.gradient(slow.rested_v, slow.soc)
    steepness = np.interp(np.nan_to_num(part.soc), slow.soc, slope) / max(float(np.median(slope)), 1e-3)
    weight = weight / np.maximum(steepness, 1.0)
    return np.where(np.isfinite(part.soc) & np.isfinite(r.voltage_v), weight, 0.0)
