"""One pass over a session's file, for everything that needs all cells over all of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from app.analysis.session_arrays import TOTALS_FIELDS, TotalsCollector
from app.analysis.survey import Piece, Survey, Surveyor
from app.battery.shape import CELLS_PER_PACK, N_PACKS
from app.estimation.arrays import FloatArray
from app.sessions.reading.reader import SessionFile
from app.sessions.reading.samples import FieldSamples
from app.sessions.storage.battery_fields import IS_NEW

_REGISTERS = tuple(f"slave[{pack}].cfgr" for pack in range(N_PACKS))  # of the team's boards
_FIELDS = ("i_fs", "v", "t", "estimate.soc")


def read_pieces(
    session: SessionFile,
    totals: TotalsCollector | None = None,
    from_s: float | None = None,
    to_s: float | None = None,
) -> Iterator[Piece]:
    """Yield the session a minute at a time on the time axis of the cell voltages; `totals` is collected meanwhile.

    `from_s` and `to_s` are a range in unix time [s], ends included.
    """
    held: dict[str, FloatArray] = {}  # the last row of each field: slow windows do not come every minute
    fields = (*_FIELDS, *_fields_of_kind(session))
    names = fields if totals is None else tuple(dict.fromkeys((*fields, *TOTALS_FIELDS)))
    for found in session.fields(names, from_s, to_s):
        if totals is not None:
            totals.add(found)
        axis = found.get("v") or found.get("i_fs")
        if axis is not None:
            yield _piece(axis.time_s, found, held, session.battery.n_cells)


def survey_session(
    session: SessionFile, also: Callable[[Piece], None] | None = None, totals: TotalsCollector | None = None
) -> Survey:
    """Return the survey of a session; `also` is given every piece, and `totals` is collected in the same pass."""
    surveyor = Surveyor(session.battery.n_cells, in_turns=session.loaded_battery.speaks_dbc is not None)
    for piece in read_pieces(session, totals):
        surveyor.add(piece)
        if also is not None:
            also(piece)
    return surveyor.result()


def _fields_of_kind(session: SessionFile) -> tuple[str, ...]:
    """The team's boards tell their switches; another battery its cells, in turns, and balancing where it says so."""
    if session.loaded_battery.speaks_dbc is None:
        return _REGISTERS
    return ("balancing", IS_NEW) if "balancing" in session.signals.order else (IS_NEW,)


def _piece(time_s: FloatArray, found: dict[str, FieldSamples], held: dict[str, FloatArray], n_cells: int) -> Piece:
    def table(name: str, width: int) -> FloatArray:
        samples = found.get(name)
        before = held.get(name, np.full(width, np.nan))
        if samples is None:
            return np.broadcast_to(before, (len(time_s), width))
        at = np.searchsorted(samples.time_s, time_s, side="right") - 1
        rows = np.where((at >= 0)[:, None], samples.values[np.maximum(at, 0)], before)
        held[name] = samples.values[-1]
        return rows

    def fresh(name: str, width: int) -> FloatArray:
        return table(name, width) if name in found else np.full((len(time_s), width), np.nan)

    balancing = fresh("balancing", n_cells)
    if any(name in found or name in held for name in _REGISTERS):
        balancing = np.concatenate([_balancing_of(table(name, 6)) for name in _REGISTERS], axis=1)
    return Piece(
        time_s=time_s,
        current_a=fresh("i_fs", 1)[:, 0],
        voltage_v=fresh("v", n_cells),
        temperature_degc=fresh("t", n_cells),
        soc=fresh("estimate.soc", n_cells),
        balancing=balancing,
        is_new=fresh(IS_NEW, n_cells) > 0.0 if IS_NEW in found else None,
    )


def _balancing_of(registers: FloatArray) -> FloatArray:
    """(n, 12) discharge switches out of the (n, 6) configuration register group: DCC1..8 in byte 4, DCC9..12 in 5."""
    known = np.isfinite(registers[:, 4]) & np.isfinite(registers[:, 5])
    low, high = (np.where(known, registers[:, k], 0.0).astype(np.int64) for k in (4, 5))
    bits = (low | (high & 0x0F) << 8)[:, None] >> np.arange(CELLS_PER_PACK) & 1
    return np.where(known[:, None], bits, np.nan)
