"""One pass over a session's file, for everything that needs all cells over all of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from app.analysis.survey import Survey, Surveyor, SurveyPiece
from app.analysis.totals import Totals
from app.battery.shape import CELLS_PER_PACK, N_PACKS
from app.estimation.arrays import FloatArray, latest_at, row_mean
from app.sessions.reading.reader import SessionFile
from app.sessions.reading.series import FieldSamples
from app.sessions.storage.battery_fields import IS_NEW

_SOC = "estimate.soc"
TOTALS_FIELDS = ("i_fs", "v_tot", "v_min", "v_min_id", "v_max", "t_max", "t_max_id", "t_avg", "soc", _SOC)


def read_totals(session: SessionFile, t_from_s: float | None = None, t_to_s: float | None = None) -> Totals:
    """Return the accumulator over a range of unix time; what a session does not hold is NaN throughout."""
    collector = TotalsCollector(session.battery.n_cells)
    for samples in session.fields(TOTALS_FIELDS, t_from_s, t_to_s):
        collector.add(samples)
    return collector.totals()


class TotalsCollector:
    """Takes what a session holds of TOTALS_FIELDS, piece by piece in order."""

    def __init__(self, n_cells: int) -> None:
        self._n_cells = n_cells
        self._pieces: dict[str, list[FieldSamples]] = {}

    def add(self, fields: Mapping[str, FieldSamples]) -> None:
        """Take the next piece; other fields are passed over."""
        for name in TOTALS_FIELDS:
            samples = fields.get(name)
            if samples is not None:
                if name == _SOC:
                    samples = FieldSamples(samples.time_s, row_mean(samples.values)[:, None])
                self._pieces.setdefault(name, []).append(samples)

    def totals(self) -> Totals:
        """Return the accumulator over all pieces.

        The state of charge is the mean of what was estimated then, the master's own count where nothing was.
        """
        series = {name: _joined(parts) for name, parts in self._pieces.items()}
        time_s = series["i_fs"][0] if "i_fs" in series else _longest(series)
        column = {name: latest_at(time_s, *series[name]) if name in series else _none(time_s) for name in TOTALS_FIELDS}
        for name, cell in (("v_min", "v_min_id"), ("t_max", "t_max_id")):
            column[cell] = np.where((column[cell] < self._n_cells) & np.isfinite(column[name]), column[cell], np.nan)
        measured = column["v_min"] > 0.0  # 0 V: no cell was measured
        return Totals(
            time_s=time_s,
            current_a=column["i_fs"],
            voltage_v=np.where(column["v_tot"] > 0.0, column["v_tot"], np.nan),
            v_min_v=np.where(measured, column["v_min"], np.nan),
            v_min_cell=np.where(measured, column["v_min_id"], np.nan),
            v_max_v=np.where(measured, column["v_max"], np.nan),
            t_max_degc=_degrees(column["t_max"]),
            t_max_cell=column["t_max_id"],
            t_mean_degc=_degrees(column["t_avg"]),
            soc=np.where(np.isfinite(column[_SOC]), column[_SOC], column["soc"]),
        )


def _degrees(values: FloatArray) -> FloatArray:
    return np.where(values > -128.0, values, np.nan)


def _joined(parts: Sequence[FieldSamples]) -> tuple[FloatArray, FloatArray]:
    return np.concatenate([part.time_s for part in parts]), np.concatenate([part.values[:, 0] for part in parts])


def _longest(series: dict[str, tuple[FloatArray, FloatArray]]) -> FloatArray:
    return max((times for times, _ in series.values()), key=len, default=np.empty(0))


def _none(time_s: FloatArray) -> FloatArray:
    return np.full(len(time_s), np.nan)


_REGISTERS = tuple(f"slave[{pack}].cfgr" for pack in range(N_PACKS))  # configuration registers of the team's boards
PIECE_S: Final = 60.0
HELD_S: Final = 60.0  # a value counts until the next one, no longer than this
_FIELDS = ("i_fs", "v", "t", "estimate.soc")


def read_pieces(
    session: SessionFile,
    totals: TotalsCollector | None = None,
    from_s: float | None = None,
    to_s: float | None = None,
) -> Iterator[SurveyPiece]:
    """Yield the session a minute at a time on the time axis of the cell voltages; `totals` is collected meanwhile.

    Minutes count from the first sample, however the session is stored: what is made of a piece, as a mean, is the same
    for a file that was committed, cut off or fetched in other parts. `from_s` and `to_s` are a range in unix time [s],
    ends included.
    """
    parts: list[SurveyPiece] = []
    first_s = minute = np.nan
    for stored in _stored_pieces(session, totals, from_s, to_s):
        first_s = float(stored.time_s[0]) if np.isnan(first_s) else first_s
        minutes = np.floor((stored.time_s - first_s) / PIECE_S)
        for begin, end in pairwise([0, *(np.flatnonzero(np.diff(minutes)) + 1).tolist(), len(minutes)]):
            if parts and minutes[begin] != minute:
                yield SurveyPiece.joined(parts)
                parts = []
            minute = float(minutes[begin])
            parts.append(stored.rows(slice(begin, end)))
    if parts:
        yield SurveyPiece.joined(parts)


def _stored_pieces(
    session: SessionFile, totals: TotalsCollector | None, from_s: float | None, to_s: float | None
) -> Iterator[SurveyPiece]:
    """The blocks of the file as pieces."""
    held: dict[str, tuple[float, FloatArray]] = {}  # time and last row of each field: some are rare
    fields = (*_FIELDS, *_fields_of_kind(session))
    names = fields if totals is None else tuple(dict.fromkeys((*fields, *TOTALS_FIELDS)))
    for samples in session.fields(names, from_s, to_s):
        if totals is not None:
            totals.add(samples)
        axis = samples.get("v") or samples.get("i_fs")
        if axis is not None:
            yield _piece(axis.time_s, samples, held, session.battery.n_cells)


def survey_session(
    session: SessionFile, also: Callable[[SurveyPiece], None] | None = None, totals: TotalsCollector | None = None
) -> Survey:
    """Return the survey of a session; `also` is given every piece, and `totals` is collected in the same pass."""
    surveyor = Surveyor(session.battery.n_cells, in_turns=session.loaded_battery.mapping is not None)
    for piece in read_pieces(session, totals):
        surveyor.add(piece)
        if also is not None:
            also(piece)
    return surveyor.result()


def _fields_of_kind(session: SessionFile) -> tuple[str, ...]:
    """The team's boards tell their switches; another battery its cells, in turns, and balancing where it says so."""
    if session.loaded_battery.mapping is None:
        return _REGISTERS
    return ("balancing", IS_NEW) if "balancing" in session.signals.order else (IS_NEW,)


def _piece(
    time_s: FloatArray, fields: dict[str, FieldSamples], held: dict[str, tuple[float, FloatArray]], n_cells: int
) -> SurveyPiece:
    def table(name: str, width: int, held_s: float = np.inf) -> FloatArray:
        samples = fields.get(name)
        before_s, before = held.get(name, (-np.inf, np.full(width, np.nan)))
        if samples is None:
            since_s, rows = np.full(len(time_s), before_s), np.broadcast_to(before, (len(time_s), width))
        else:
            at = np.searchsorted(samples.time_s, time_s, side="right") - 1
            own, at = at >= 0, np.maximum(at, 0)
            since_s = np.where(own, samples.time_s[at], before_s)
            rows = samples.values[at] if own.all() else np.where(own[:, None], samples.values[at], before)
            held[name] = (float(samples.time_s[-1]), samples.values[-1])
        is_old = time_s - since_s > held_s
        return np.where(is_old[:, None], np.nan, rows) if is_old.any() else rows

    def fresh(name: str, width: int) -> FloatArray:
        return table(name, width, HELD_S)

    balancing = fresh("balancing", n_cells)
    if any(name in fields or name in held for name in _REGISTERS):
        balancing = np.concatenate([_balancing_of(table(name, 6)) for name in _REGISTERS], axis=1)
    return SurveyPiece(
        time_s=time_s,
        current_a=fresh("i_fs", 1)[:, 0],
        voltage_v=fresh("v", n_cells),
        temperature_degc=fresh("t", n_cells),
        soc=fresh("estimate.soc", n_cells),
        balancing=balancing,
        is_new=fresh(IS_NEW, n_cells) > 0.0 if IS_NEW in fields else None,
    )


def _balancing_of(registers: FloatArray) -> FloatArray:
    """(n, 12) discharge switches out of the (n, 6) configuration register group: DCC1..8 in byte 4, DCC9..12 in 5."""
    is_finite = np.isfinite(registers[:, 4]) & np.isfinite(registers[:, 5])
    low, high = (np.where(is_finite, registers[:, k], 0.0).astype(np.int64) for k in (4, 5))
    bits = (low | (high & 0x0F) << 8)[:, None] >> np.arange(CELLS_PER_PACK) & 1
    return np.where(is_finite[:, None], bits, np.nan)
