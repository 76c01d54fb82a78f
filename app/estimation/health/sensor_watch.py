"""Sensors that do not show their cell: a thermistor that came off, a voltage channel that stands still.

Every rule asks for what no cell can do: warm by JUMP_K in seconds, be far colder than the air that it shares, keep its
temperature or its voltage while those around it move.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from app.estimation.arrays import BoolArray, FloatArray
from app.estimation.health.cell_finding import CellFinding
from app.estimation.health.packs import Packs

JUMP_K: Final = 8.0  # against the pack within JUMP_S; 50 W warm a cell by 1 K in that time
JUMP_S: Final = 10.0
COLD_K: Final = 15.0  # below the pack's median
FROZEN_K: Final = 6.0  # by which the pack moved while the sensor showed one value
BACK_K: Final = 5.0  # from the pack: it shows the cell again
STILL_V: Final = 1.5e-3  # a live channel's noise and the cell's own movement exceed it
MOVED_V: Final = 30e-3  # voltage of the median cell meanwhile
HOP_V: Final = 0.15  # in one sample without current; a short of 75 A does less
QUIET_V: Final = 5e-3  # the others in that sample
REST_A: Final = 1.0
MISSING_S: Final = 5.0  # without a value, while the pack has values
CONFIRM_S: Final = 2.0
RELEASE_S: Final = 20.0  # time of sound values
SAMPLE_S: Final = 1.5  # a sample counts for no longer: what was not measured neither begins nor ends anything
GAP_S: Final = 2.0  # over a hole nothing is compared
PACK_SHARE: Final = 0.5  # share of the pack has to be there


@dataclass(frozen=True)
class DeadSensors:
    """One kind of sensor, (n_cells,).

    Attributes:
        is_dead: which do not show their cell.
        size: what shows it, in the unit of the sensor: the distance from the pack, or the movement that it did not
            follow; NaN where it shows no value.
        value: what they show, NaN where nothing.
        usual: what the rest of the pack shows.
        seen_s: when that was last seen.
        since_s: when it began.
    """

    is_dead: BoolArray
    size: FloatArray
    value: FloatArray
    usual: FloatArray
    seen_s: FloatArray
    since_s: FloatArray


class _Verdicts:
    """What is suspected of each cell, for how long, and what was found."""

    def __init__(self, n_cells: int) -> None:
        self.is_dead = np.zeros(n_cells, dtype=np.bool_)
        self.size, self.value, self.usual, self.seen_s, self.since_s = np.full((5, n_cells), np.nan)
        self._suspect_s, self._sound_s = np.zeros((2, n_cells))

    def remember(self, findings: Iterable[CellFinding]) -> None:
        """Go on with what an earlier session found: only sound values end it."""
        for finding in findings:
            self.is_dead[finding.cell] = True
            self.size[finding.cell], self.value[finding.cell], self.usual[finding.cell] = (
                finding.size,
                finding.value,
                finding.usual,
            )
            self.seen_s[finding.cell], self.since_s[finding.cell] = finding.seen_s, finding.since_s

    def add(
        self,
        time_s: float,
        dt_s: float,
        suspect: BoolArray,
        sound: BoolArray,
        delay_s: BoolArray | FloatArray | float,
        shown: tuple[FloatArray, FloatArray, FloatArray],
    ) -> None:
        """Take one sample: which look faulty, which sound, how long either lasts before it counts, what shows it."""
        dt_s = min(dt_s, SAMPLE_S)
        self._suspect_s = np.where(suspect, self._suspect_s + dt_s, 0.0)
        self._sound_s = np.where(suspect, 0.0, self._sound_s + dt_s * sound)
        counts = suspect & (self._suspect_s >= delay_s)
        self.since_s = np.where(counts & ~self.is_dead, time_s - self._suspect_s, self.since_s)
        self.is_dead = (self.is_dead | counts) & (self._sound_s < RELEASE_S)
        self.seen_s = np.where(counts, time_s, self.seen_s)
        for name, array in zip(("size", "value", "usual"), shown, strict=True):
            setattr(self, name, np.where(counts, array, getattr(self, name)))

    def result(self) -> DeadSensors:
        """Return them."""
        return DeadSensors(self.is_dead.copy(), self.size, self.value, self.usual, self.seen_s, self.since_s)


class ThermistorWatch:
    """Call `step` every second or so."""

    def __init__(self, packs: Packs, findings: Iterable[CellFinding] = ()) -> None:
        """Start, or go on with what an earlier session found of thermistors."""
        n_cells = packs.n_cells
        self._packs = packs
        self._verdicts = _Verdicts(n_cells)
        self._verdicts.remember(findings)
        self._apart_k = np.full(n_cells, np.nan)  # slow mean of the distance from the pack
        self._jumped_k = np.zeros(n_cells)
        self._frozen_at = np.full((2, n_cells), np.nan)  # value, and the pack's when it last changed

    def step(
        self, time_s: float, dt_s: float, temperatures_degc: FloatArray, has_voltage: BoolArray | None = None
    ) -> None:
        """Take one sample.

        Args:
            time_s: when it was measured [s].
            dt_s: since the last one taken [s].
            temperatures_degc: (n_cells,) [degC]; NaN = missing.
            has_voltage: (n_cells,) which cells have a voltage; None: all. An open sense wire takes the voltages of the
                cells next to it and the temperatures that are read through its input, which may be other cells': in
                its pack a missing temperature says nothing of its sensor.
        """
        t = temperatures_degc
        pack, is_there = self._packs.median(t), self._packs.has_more_than(PACK_SHARE, np.isfinite(t))
        apart = t - pack
        if dt_s > RELEASE_S:
            self._apart_k[:] = np.nan
        is_new = np.isnan(self._apart_k) & np.isfinite(apart)
        self._apart_k[is_new] = apart[is_new]
        step_k = np.nan_to_num(apart - self._apart_k)
        has_jumped = np.abs(step_k) >= JUMP_K
        self._jumped_k = np.where(has_jumped, apart, self._jumped_k)
        share = min(dt_s / JUMP_S, 1.0)
        self._apart_k += np.where(has_jumped | self._verdicts.is_dead, 0.0, share) * step_k
        is_cold = apart < -COLD_K
        has_changed = ~(np.abs(t - self._frozen_at[0]) < 0.5) & np.isfinite(t)
        self._frozen_at = np.where(has_changed, (t, pack), self._frozen_at)
        moved_k = pack - self._frozen_at[1]
        is_frozen = np.nan_to_num(np.abs(moved_k)) >= FROZEN_K
        is_missing = np.isnan(t) & is_there
        if has_voltage is not None and not has_voltage.all():
            is_missing &= ~self._packs.has_more_than(0.0, ~has_voltage)
        suspect = (has_jumped | is_cold | is_frozen | is_missing) & is_there
        is_back = np.abs(apart) < BACK_K
        size = np.where(is_missing, np.nan, np.abs(np.where(is_frozen & ~has_jumped & ~is_cold, moved_k, apart)))
        delay_s = np.where(is_missing, MISSING_S, CONFIRM_S)
        self._verdicts.add(time_s, dt_s, suspect, is_back, delay_s, (size, t, pack))
        self._apart_k = np.where(is_back & ~self._verdicts.is_dead & has_jumped, apart, self._apart_k)

    def result(self) -> DeadSensors:
        """Return the thermistors that came off."""
        return self._verdicts.result()


class ChannelWatch:
    """Call `step` some times a second."""

    def __init__(self, packs: Packs, findings: Iterable[CellFinding] = ()) -> None:
        """Start, or go on with what an earlier session found of voltage channels."""
        n_cells = packs.n_cells
        self._packs = packs
        self._verdicts = _Verdicts(n_cells)
        self._verdicts.remember(findings)
        self._still_v = np.full(n_cells, np.nan)  # where each cell last moved to
        self._others_v = np.full((2, n_cells), np.nan)  # lowest and highest median of all since
        self._before = (np.full(n_cells, np.nan), np.nan, np.inf)  # voltages, median, current
        self._hopped = np.zeros(n_cells, dtype=np.bool_)

    @property
    def is_dead(self) -> BoolArray:
        """(n_cells,) channels that do not show their cell."""
        return self._verdicts.is_dead

    def step(
        self,
        time_s: float,
        dt_s: float,
        current_a: float,
        voltages_v: FloatArray,
        measured: BoolArray | None = None,
    ) -> None:
        """Take one sample.

        Args:
            time_s: when it was measured [s].
            dt_s: since the last one taken [s].
            current_a: positive on discharge [A].
            voltages_v: (n_cells,) [V]; NaN = not in this sample.
            measured: (n_cells,) which cells had a value since the last one taken; None: those that have one now.
        """
        v = voltages_v
        finite = v[np.isfinite(v)]
        if not finite.size:
            return
        median_v = float(np.median(finite))
        before_v, before_median_v, before_a = self._before
        self._before = v, median_v, current_a
        has_moved = ~(np.abs(v - self._still_v) <= STILL_V) | (dt_s > GAP_S)
        self._still_v = np.where(has_moved, v, self._still_v)
        low, high = self._others_v
        self._others_v = np.where(has_moved, median_v, (np.fmin(low, median_v), np.fmax(high, median_v)))
        moved_v = self._others_v[1] - self._others_v[0]
        is_still = (moved_v >= MOVED_V) & np.isfinite(v)
        if abs(current_a) < REST_A and abs(before_a) < REST_A and 0.0 < dt_s <= GAP_S:
            hop_v = np.nan_to_num(v - before_v)
            self._hopped ^= (np.abs(hop_v) > HOP_V) & (abs(median_v - before_median_v) < QUIET_V)
        elif abs(current_a) >= REST_A:
            self._hopped &= ~has_moved  # it follows the current
        suspect = is_still | self._hopped
        is_missing = np.isnan(v) if measured is None else ~measured
        if is_missing.any():
            suspect |= is_missing & self._packs.has_more_than(PACK_SHARE, ~is_missing)
        size = np.where(is_missing, np.nan, np.where(is_still, moved_v, np.abs(v - median_v)))
        delay_s = np.where(is_missing, MISSING_S, np.where(is_still, CONFIRM_S, 0.0))
        usual = np.full(len(v), median_v)
        is_back = ~is_missing & (has_moved | np.isnan(self._verdicts.size))
        self._verdicts.add(time_s, dt_s, suspect, is_back, delay_s, (size, v, usual))

    def result(self) -> DeadSensors:
        """Return the channels that stand still, hop, or show nothing."""
        return self._verdicts.result()
