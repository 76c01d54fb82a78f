"""Loose busbar joints, by the resistances of all cells.

A cell's measuring span holds the cell and one joint. An aged cell grows in both coefficients of the regression
(`resistance_tracker.py`) in proportion, a joint in the first alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from app.estimation.arrays import BoolArray, FloatArray, median, robust_sigma
from app.estimation.errors import ShapeError
from app.estimation.health.packs import Packs, medians

POLISH_ROUNDS: Final = 6
LESS_SIGMAS: Final = 3.0  # multiple of sound cells' scatter by which a cell may resist less than its peers
SLOPE_MAX: Final = 5.0  # ohmic over pair resistance; more means that the pair was hardly seen


@dataclass(frozen=True)
class JointReport:
    """Joints by the pattern of resistances over the accumulator; all arrays are (n_cells,).

    Attributes:
        resistance_ohm: ohmic resistance of cell and joint [ohm], NaN where not known.
        cell_growth_frac: how much more the cell itself resists than its peers, as a fraction.
        ohmic_excess_ohm: how much more cell and joint together resist than their peers [ohm].
        joint_excess_ohm: how much more its joint resists: than its peers', or than it did when that is known [ohm].
        sigma_ohm: standard deviation of the joint's excess: scatter of the regression and of sound peers [ohm].
        is_loose: the joint's excess is above the alarm value and cannot be scatter.
    """

    resistance_ohm: FloatArray
    cell_growth_frac: FloatArray
    ohmic_excess_ohm: FloatArray
    joint_excess_ohm: FloatArray
    sigma_ohm: FloatArray
    is_loose: BoolArray


def judge_joints(
    resistance_ohm: FloatArray,
    sigma_ohm: FloatArray,
    packs: Packs,
    temperature_factor: ArrayLike = 1.0,
    alarm_ohm: float = 1.75e-4,
    alarm_sigmas: float = 4.0,
    baseline_ohm: ArrayLike | None = None,
) -> JointReport:
    """Return cell and joint apart, and the joints that are loose.

    The peers of a cell are its pack (same air, same heat) and its position in the other packs (same busbar). What they
    share is taken away by Tukey's median polish. Of what is left, cell and joint are parted by the pair's resistance:

        e_ohmic = g R_ohmic + j,   e_pair = g R_pair

    As far as the sound cells show that both spread together, their slope is used; a cell far outside takes all of it.
    No cell resists less than its peers by more than they scatter: a pair that was not seen well makes no joint of it.
    Where the past of a cell is known its whole growth is the joint's: no cell ages within a session.

    Args:
        resistance_ohm: (2, n_cells) of `ResistanceTracker.resistance_ohm`.
        sigma_ohm: (2, n_cells) of `ResistanceTracker.sigma_ohm`.
        packs: which cells share a pack.
        temperature_factor: (n_cells,) or scalar, resistance of the cell at its temperature over that at the mean.
        alarm_ohm: excess above which a joint is loose [ohm].
        alarm_sigmas: and this many standard deviations.
        baseline_ohm: (n_cells,) `ohmic_excess_ohm` of the same car when it was sound [ohm]; NaN where not known.

    Raises:
        ShapeError: an array is not (2, n_cells), or the packs have another number of cells.
    """
    if resistance_ohm.shape != sigma_ohm.shape or resistance_ohm.ndim != 2 or resistance_ohm.shape[0] != 2:
        raise ShapeError("sigma_ohm", resistance_ohm.shape, sigma_ohm.shape)
    n = resistance_ohm.shape[1]
    if n != packs.n_cells:
        raise ShapeError("resistance_ohm", (2, packs.n_cells), resistance_ohm.shape)
    factor = np.broadcast_to(np.asarray(temperature_factor, dtype=np.float64), (n,))
    typical = np.array([median(row) for row in resistance_ohm])
    excess = resistance_ohm - typical[:, None] * factor
    ohmic, pair = (packs.flat(_polished(packs.table(row))) for row in excess)
    full_slope = float(typical[0] / max(typical[1], abs(typical[0]) / SLOPE_MAX)) if typical[0] > 0.0 else 0.0
    shown_slope = float(np.clip(_slope_of_sound(pair, ohmic), 0.0, full_slope))
    scatter = max(robust_sigma(pair), 1e-12)
    outlying = np.clip((np.abs(pair) / scatter - 4.0) / 4.0, 0.0, 1.0)
    slope = shown_slope + (full_slope - shown_slope) * outlying
    from_cell = np.maximum(slope * pair, -LESS_SIGMAS * robust_sigma(ohmic))
    past = np.broadcast_to(np.asarray(np.nan if baseline_ohm is None else baseline_ohm, dtype=np.float64), (n,))
    has_past = np.isfinite(past)
    joint = ohmic - np.where(has_past, past, from_cell)
    scatter_ohm = np.where(has_past, _sound_sigma(joint[has_past]), _sound_sigma(ohmic - from_cell))
    scatter_ohm = np.hypot(scatter_ohm, np.where(has_past, 0.0, slope * np.nan_to_num(sigma_ohm[1])))
    sigma = np.hypot(np.nan_to_num(sigma_ohm[0], nan=np.inf), scatter_ohm)
    is_loose = np.nan_to_num(joint) > np.maximum(alarm_ohm, alarm_sigmas * sigma)
    growth = from_cell / max(float(typical[0]), 1e-12)
    return JointReport(resistance_ohm[0], growth, ohmic, joint, sigma, is_loose)


def _slope_of_sound(pair: FloatArray, ohmic: FloatArray) -> float:
    """Return the slope of ohmic over pair excess among the cells within three sigma in both."""
    sound = (np.abs(pair) < 3.0 * robust_sigma(pair)) & (np.abs(ohmic) < 3.0 * robust_sigma(ohmic))
    if sound.sum() < 8:
        return 0.0
    return float(np.sum(pair[sound] * ohmic[sound]) / np.sum(pair[sound] ** 2))


def _sound_sigma(values: FloatArray) -> float:
    """Return the standard deviation of the values within four sigma of the median by their MAD."""
    sound = values[np.abs(values - median(values)) <= 4.0 * robust_sigma(values)]
    return float(np.std(sound)) if sound.size else float("nan")


def _polished(table: FloatArray) -> FloatArray:
    """Return the (packs, cells) residual after taking away medians of rows and columns in turn (Tukey 1977)."""
    residual = table.copy()
    if not np.isfinite(residual).any():
        return residual
    rounds = POLISH_ROUNDS if table.shape[0] >= 3 else 1
    for _ in range(rounds):
        residual -= np.nan_to_num(medians(residual, axis=1))
        if table.shape[0] >= 3:
            residual -= np.nan_to_num(medians(residual, axis=0))
    return residual
