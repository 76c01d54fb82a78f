"""The least-squares problem of the identification: recordings and priors in, coefficients and their cost out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.errors import ModelError
from app.estimation.identification.design import BLEND_SOC, OFFSET_SOC, OVERPOTENTIAL_SOC, RESISTANCE_SOC, Design
from app.estimation.identification.parts import Part
from app.estimation.identification.slow_tests import SlowCurves
from app.estimation.identification.solvers import non_negative_least_squares

Activation = tuple[float, float, float]  # of R0, of the R_k, of the overpotential [J/mol]

DEFAULT_ACTIVATION: Final = (20e3, 20e3, 20e3)  # the usual size for lithium-ion cells, kept without evidence
ACTIVATION_SIGMA: Final = 15e3  # how far from the default a cell may be expected
SMOOTH_FRAC: Final = 0.5  # how far a resistance may bend from knot to knot, of the typical resistance
RESISTANCE_LIMIT_FRAC: Final = 100.0
R0_FLOOR_FRAC: Final = 0.3  # of the typical resistance: a fast pair may not take all of R0 where data is thin
OVERPOTENTIAL_SIGMA_V: Final = 0.1
OFFSET_SIGMA_V: Final = 0.0005  # the two slow branches bracket the OCV ...
OFFSET_SIGMA_ALONE_V: Final = 0.02  # ... a discharge alone does not
ROBUST_ROUNDS: Final = 2


@dataclass(frozen=True)
class Solution:
    """Coefficients `x` in the order of the design's columns, and what they cost; the lower the better."""

    cost: float
    tau_s: tuple[float, ...]
    activation: Activation
    x: FloatArray

    @property
    def r0_ohm(self) -> FloatArray:
        """(knots,) ohmic resistance at 25 degC."""
        return self.x[: RESISTANCE_SOC.size]

    @property
    def r_ohm(self) -> FloatArray:
        """(n_rc, knots) resistances of the RC pairs at 25 degC."""
        n = RESISTANCE_SOC.size
        return self.x[n : n * (1 + len(self.tau_s))].reshape(-1, n)

    @property
    def overpotential_v(self) -> FloatArray:
        """(4,) factor of the asinh term at `OVERPOTENTIAL_SOC`, 25 degC [V]."""
        start = RESISTANCE_SOC.size * (1 + len(self.tau_s))
        return self.x[start : start + OVERPOTENTIAL_SOC.size]

    def ocv(self, slow: SlowCurves, soc: FloatArray) -> FloatArray:
        """Return the OCV [V] at (n,) SOC: between the slow branches, plus the fitted offset."""
        offset = self.x[-OFFSET_SOC.size :]
        blend = self.x[-OFFSET_SOC.size - BLEND_SOC.size : -OFFSET_SOC.size]
        gap_v = np.interp(soc, slow.soc, slow.charge_v - slow.discharge_v)
        value = np.interp(soc, slow.soc, slow.discharge_v) + np.interp(soc, BLEND_SOC, blend) * gap_v
        return np.asarray(value + np.interp(soc, OFFSET_SOC, offset))


class Problem:
    """All recordings of one cell and the priors; solves for the coefficients at given time constants."""

    def __init__(self, parts: Sequence[Part], slow: SlowCurves, capacity_ah: float, typical_ohm: float) -> None:
        self.designs = [Design(part, slow, capacity_ah) for part in parts]
        self._typical_ohm = typical_ohm
        self._offset_sigma_v = OFFSET_SIGMA_V if slow.has_charge else OFFSET_SIGMA_ALONE_V

    def equations(self, tau_s: tuple[float, ...], activation: Activation) -> tuple[FloatArray, FloatArray]:
        """Return gram and moment over all recordings, priors included."""
        gram = self.prior(len(tau_s))
        moment = np.zeros(gram.shape[0])
        for design in self.designs:
            g, c = design.normal_equations(design.columns(tau_s, activation))
            gram += g
            moment += c
        return gram, moment

    def prior(self, n_rc: int) -> FloatArray:
        """Return the gram matrix of what is believed before any data: smooth resistances, small offsets."""
        n = RESISTANCE_SOC.size
        bend = np.diff(np.eye(n), 2, axis=0)
        resistance = bend.T @ bend / (SMOOTH_FRAC * self._typical_ohm) ** 2
        resistance += np.eye(n) / (RESISTANCE_LIMIT_FRAC * self._typical_ohm) ** 2
        offset_bend = np.diff(np.eye(OFFSET_SOC.size), 2, axis=0)
        offset = (np.eye(OFFSET_SOC.size) + offset_bend.T @ offset_bend) / self._offset_sigma_v**2
        blocks = [resistance] * (1 + n_rc)
        blocks += [np.eye(OVERPOTENTIAL_SOC.size) / OVERPOTENTIAL_SIGMA_V**2, np.eye(BLEND_SOC.size), offset]
        return _block_diagonal(blocks)

    def solve(self, tau_s: tuple[float, ...], activation: Activation) -> Solution:
        """Return the best coefficients for these time constants and activation energies."""
        gram, moment = self.equations(tau_s, activation)
        return self._finish(gram, moment, tau_s, activation)

    def choose_tau(self, candidates: Sequence[float], n_rc: int, activation: Activation) -> Solution:
        """Return the best solution over all choices of n_rc among the candidates."""
        gram, moment = self.equations(tuple(candidates), activation)
        n = RESISTANCE_SOC.size
        tail = np.arange(n * (1 + len(candidates)), moment.size)
        best: Solution | None = None
        for chosen in combinations(range(len(candidates)), n_rc):
            keep = np.concatenate((np.arange(n), *(np.arange(n * (1 + k), n * (2 + k)) for k in chosen), tail))
            tau_s = tuple(candidates[k] for k in chosen)
            solution = self._finish(gram[np.ix_(keep, keep)], moment[keep], tau_s, activation)
            if best is None or solution.cost < best.cost:
                best = solution
        if best is None:
            raise ModelError("--rc", f"{n_rc} time constants cannot be told apart at this sampling")
        return best

    def robust(self, start: Solution) -> Solution:
        """Return the solution with samples far off counted less: Huber weights at three times the median."""
        solution = start
        for _ in range(ROBUST_ROUNDS):
            gram = self.prior(len(start.tau_s))
            moment = np.zeros(gram.shape[0])
            for design in self.designs:
                columns = design.columns(start.tau_s, start.activation)
                error = np.abs(design.target - columns @ solution.x)
                limit = 3.0 * float(np.median(error))
                g, c = design.normal_equations(columns, np.minimum(1.0, limit / np.maximum(error, 1e-9)))
                gram += g
                moment += c
            solution = self._finish(gram, moment, start.tau_s, start.activation)
        return solution

    def _finish(
        self, gram: FloatArray, moment: FloatArray, tau_s: tuple[float, ...], activation: Activation
    ) -> Solution:
        is_free = np.arange(moment.size) >= moment.size - OFFSET_SOC.size
        least = np.zeros(moment.size)
        least[: RESISTANCE_SOC.size] = R0_FLOOR_FRAC * self._typical_ohm
        x = least + non_negative_least_squares(gram, moment - gram @ least, is_free)
        cost = float(x @ gram @ x - 2.0 * x @ moment)
        cost += sum(((e - d) / ACTIVATION_SIGMA) ** 2 for e, d in zip(activation, DEFAULT_ACTIVATION, strict=True))
        return Solution(cost, tau_s, activation, x)


def _block_diagonal(blocks: Sequence[FloatArray]) -> FloatArray:
    n = sum(block.shape[0] for block in blocks)
    matrix = np.zeros((n, n))
    at = 0
    for block in blocks:
        end = at + block.shape[0]
        matrix[at:end, at:end] = block
        at = end
    return matrix
