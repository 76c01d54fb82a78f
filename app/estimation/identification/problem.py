"""The least-squares problem of the identification: recordings and priors in, coefficients and their cost out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import GAS_CONSTANT, KELVIN
from app.estimation.errors import ModelError
from app.estimation.identification.design import (
    BLEND_SOC,
    OFFSET_SOC,
    OVERPOTENTIAL_SOC,
    RESISTANCE_SOC,
    Design,
)
from app.estimation.identification.parts import Part
from app.estimation.identification.slow_tests import SlowCurves
from app.estimation.identification.solvers import non_negative_least_squares

SMOOTH_FRAC: Final = 0.5  # how far a resistance may bend from knot to knot, of the typical resistance
RESISTANCE_LIMIT_FRAC: Final = 100.0
R0_FLOOR_FRAC: Final = 0.3  # of the typical resistance: a fast pair may not take all of R0 where data is thin
OVERPOTENTIAL_SIGMA_V: Final = 0.1
OFFSET_SIGMA_V: Final = 0.0005  # the two slow branches bracket the OCV ...
OFFSET_SIGMA_ALONE_V: Final = 0.02  # ... a discharge alone does not
SHIFT_SIGMA_V_K: Final = 0.001  # of the OCV with temperature: entropy, and what rests of hours do not reach in the cold
NEIGHBOUR_FRAC: Final = 0.3  # of the typical resistance, by which tables at two temperatures may differ at least ...
ACTIVATION_SIGMA_J_MOL: Final = 15e3  # ... and with their distance
ROBUST_ROUNDS: Final = 2


@dataclass(frozen=True)
class Solution:
    """Coefficients `x` in the order of the design's columns, and what they cost; the lower the better."""

    cost: float
    tau_s: tuple[float, ...]
    knots_degc: FloatArray
    x: FloatArray

    @property
    def _n(self) -> int:
        return self.knots_degc.size * RESISTANCE_SOC.size

    @property
    def r0_ohm(self) -> FloatArray:
        """(n_t, knots) ohmic resistance, as at 25 degC."""
        return self.x[: self._n].reshape(self.knots_degc.size, -1)

    @property
    def r_ohm(self) -> FloatArray:
        """(n_rc, n_t, knots) resistances of the RC pairs, as at 25 degC."""
        n = self._n
        return self.x[n : n * (1 + len(self.tau_s))].reshape(-1, self.knots_degc.size, RESISTANCE_SOC.size)

    @property
    def overpotential_v(self) -> FloatArray:
        """(n_t, 4) factor of the asinh term at `OVERPOTENTIAL_SOC`, as at 25 degC [V]."""
        start = self._n * (1 + len(self.tau_s))
        return self.x[start : start + self.knots_degc.size * OVERPOTENTIAL_SOC.size].reshape(self.knots_degc.size, -1)

    @property
    def offset_v(self) -> FloatArray:
        """(n_t, 11) what the OCV at `OFFSET_SOC` is above the blend of the slow branches [V]."""
        return self.x[-self.knots_degc.size * OFFSET_SOC.size :].reshape(self.knots_degc.size, -1)

    def blended_v(self, slow: SlowCurves, soc: FloatArray) -> FloatArray:
        """Return (n,) voltage between the slow branches at (n,) SOC, without the offset [V]."""
        start = self.x.size - self.knots_degc.size * OFFSET_SOC.size - BLEND_SOC.size
        blend = self.x[start : start + BLEND_SOC.size]
        gap_v = np.interp(soc, slow.soc, slow.charge_v - slow.discharge_v)
        return np.asarray(np.interp(soc, slow.soc, slow.discharge_v) + np.interp(soc, BLEND_SOC, blend) * gap_v)


class Problem:
    """All recordings of one cell and the priors; solves for the coefficients at given time constants."""

    def __init__(
        self,
        parts: Sequence[Part],
        slow: SlowCurves,
        capacity_ah: float,
        typical_ohm: float,
        knots_degc: FloatArray,
        slow_degc: float,
    ) -> None:
        self.designs = [Design(part, slow, capacity_ah, knots_degc) for part in parts]
        self._typical_ohm = typical_ohm
        self._offset_sigma_v = OFFSET_SIGMA_V if slow.has_charge else OFFSET_SIGMA_ALONE_V
        self._knots_degc = knots_degc
        self._slow_degc = slow_degc

    def equations(self, tau_s: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
        """Return gram and moment over all recordings, priors included."""
        gram = self.prior(len(tau_s))
        moment = np.zeros(gram.shape[0])
        for design in self.designs:
            design.add_equations(gram, moment, tau_s, design.columns(tau_s))
        return gram, moment

    def prior(self, n_rc: int) -> FloatArray:
        """Return the gram matrix of what is believed before any data.

        Resistances bend little over SOC and follow the usual activation energy over temperature; offsets are small.
        """
        n, n_t = RESISTANCE_SOC.size, self._knots_degc.size
        bend = np.diff(np.eye(n), 2, axis=0)
        resistance = bend.T @ bend / (SMOOTH_FRAC * self._typical_ohm) ** 2
        resistance += np.eye(n) / (RESISTANCE_LIMIT_FRAC * self._typical_ohm) ** 2
        step = np.diff(np.eye(n_t), axis=0)
        apart = ACTIVATION_SIGMA_J_MOL / GAS_CONSTANT * np.abs(np.diff(1.0 / (self._knots_degc + KELVIN)))
        step /= np.hypot(apart, NEIGHBOUR_FRAC)[:, None] if n_t > 1 else 1.0
        like = step.T @ step
        resistance = np.kron(np.eye(n_t), resistance) + np.kron(like, np.eye(n)) / self._typical_ohm**2
        over = np.kron(np.eye(n_t) + like, np.eye(OVERPOTENTIAL_SOC.size)) / OVERPOTENTIAL_SIGMA_V**2
        offset_bend = np.diff(np.eye(OFFSET_SOC.size), 2, axis=0)
        shift_v = np.hypot(self._offset_sigma_v, SHIFT_SIGMA_V_K * (self._knots_degc - self._slow_degc))
        offset = np.kron(np.diag(shift_v**-2.0), np.eye(OFFSET_SOC.size) + offset_bend.T @ offset_bend)
        blocks: list[FloatArray] = [np.asarray(resistance)] * (1 + n_rc)
        blocks += [np.asarray(over), np.eye(BLEND_SOC.size), np.asarray(offset)]
        return _block_diagonal(blocks)

    def solve(self, tau_s: tuple[float, ...]) -> Solution:
        """Return the best coefficients for these time constants."""
        return self._finish(*self.equations(tau_s), tau_s)

    def choose_tau(self, candidates: Sequence[float], n_rc: int) -> Solution:
        """Return the best solution over all choices of n_rc among the candidates."""
        gram, moment = self.equations(tuple(candidates))
        n = RESISTANCE_SOC.size * self._knots_degc.size
        tail = np.arange(n * (1 + len(candidates)), moment.size)
        best: Solution | None = None
        for chosen in combinations(range(len(candidates)), n_rc):
            keep = np.concatenate((np.arange(n), *(np.arange(n * (1 + k), n * (2 + k)) for k in chosen), tail))
            tau_s = tuple(candidates[k] for k in chosen)
            solution = self._finish(gram[np.ix_(keep, keep)], moment[keep], tau_s)
            if best is None or solution.cost < best.cost:
                best = solution
        if best is None:
            raise ModelError("--rc", f"{n_rc} time constants cannot be told apart at this sampling")
        return best

    def robust(self, start: Solution, told: Callable[[], None] = lambda: None) -> Solution:
        """Return the solution with samples far off counted less: Huber weights at three times the median.

        `told` is called after each round.
        """
        solution = start
        for _ in range(ROBUST_ROUNDS):
            gram = self.prior(len(start.tau_s))
            moment = np.zeros(gram.shape[0])
            for design in self.designs:
                columns = design.columns(start.tau_s)
                error = np.abs(design.target - columns @ solution.x[design.places(len(start.tau_s))])
                limit = 3.0 * float(np.median(error))
                trust = np.minimum(1.0, limit / np.maximum(error, 1e-9))
                design.add_equations(gram, moment, start.tau_s, columns, trust)
            solution = self._finish(gram, moment, start.tau_s)
            told()
        return solution

    def _finish(self, gram: FloatArray, moment: FloatArray, tau_s: tuple[float, ...]) -> Solution:
        n_t = self._knots_degc.size
        is_free = np.arange(moment.size) >= moment.size - n_t * OFFSET_SOC.size
        least = np.zeros(moment.size)
        least[: n_t * RESISTANCE_SOC.size] = R0_FLOOR_FRAC * self._typical_ohm
        x = least + non_negative_least_squares(gram, moment - gram @ least, is_free)
        cost = float(x @ gram @ x - 2.0 * x @ moment)
        return Solution(cost, tau_s, self._knots_degc, x)


def _block_diagonal(blocks: Sequence[FloatArray]) -> FloatArray:
    n = sum(block.shape[0] for block in blocks)
    matrix = np.zeros((n, n))
    at = 0
    for block in blocks:
        end = at + block.shape[0]
        matrix[at:end, at:end] = block
        at = end
    return matrix
