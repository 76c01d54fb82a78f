"""What a stretch of a session shows, as arrays: the only thing that hypotheses look at; and how it is read."""

from __future__ import annotations

from bisect import bisect_right
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from app.analysis.incidents import Trigger, trigger_of_event
from app.analysis.limits import limits_over_time
from app.battery.shape import N_PACKS
from app.estimation.arrays import FloatArray, latest_at, row_median
from app.estimation.health.stretch import Stretch
from app.sessions.reading.reader import SessionFile
from app.sessions.reading.series import FieldSamples
from app.sessions.storage.battery_fields import IS_NEW
from app.words import Message
from firmware_protocol.can_tables import rx_messages, tx_messages
from firmware_protocol.config_image import default_image
from firmware_protocol.elcon import STATUS_ID
from firmware_protocol.memory_map import CAN_ID_EXTENDED, CHIP_MISSING, STATUS_FLAGS

IntArray = NDArray[np.int64]
UNKNOWN = -1  # of a byte that was not received


@dataclass(frozen=True)
class Boards:
    """What the slave boards said, (m,) times [s] and a row each; a board that said nothing has no row."""

    time_s: FloatArray
    status: FloatArray  # (m, packs)
    damaged: FloatArray  # (m, packs) packets in the last second that arrived damaged
    failed_tests: FloatArray  # (m, packs) bits of the self-tests that failed
    own_degc: FloatArray  # (m, packs) temperature of the chip


@dataclass(frozen=True)
class LineTraffic:
    """RS232: arrival of good frames and of damaged ones [s]; the length of the damaged ones against a good one's."""

    good_s: FloatArray
    bad_s: FloatArray
    bad_length: FloatArray


@dataclass(frozen=True)
class BusTraffic:
    """CAN: arrivals [s] by identifier (bit 31: 29 bits); what the master sends by its tables, with the period [s]."""

    times_s: Mapping[int, FloatArray]
    master_period_s: Mapping[int, float]
    charger_id: int | None
    shares: FloatArray = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True, kw_only=True)
class Recording(Stretch):
    """A stretch of a session; NaN and UNKNOWN = not measured.

    Attributes:
        flags: (n,) the master's status bits by `bit`.
        charger_state, charger_flags: (n,) as the master has them.
        fan_duty: (n,) 0..1.
        events: everything that was reported in the stretch, in order, at unix times.
        limits: of the configuration then, by name; empty where it was not received.
    """

    flags: IntArray
    charger_state: IntArray
    charger_flags: IntArray
    fan_duty: FloatArray
    boards: Boards
    line: LineTraffic
    bus: BusTraffic
    events: Sequence[Trigger]
    limits: Mapping[str, float]
    bits: Mapping[str, int]

    def bit(self, name: str) -> FloatArray:
        """(n,) 1 or 0, NaN where not received."""
        known = self.flags != UNKNOWN
        return np.where(known, self.flags >> self.bits[name] & 1, np.nan)

    def near(self, from_s: float, to_s: float) -> slice:
        """Samples between two unix times, both included."""
        low, high = np.searchsorted(self.time_s, from_s), np.searchsorted(self.time_s, to_s, side="right")
        return slice(int(low), int(high))


@dataclass(frozen=True)
class Suspicion:
    """A hypothesis with what speaks for it.

    Attributes:
        code: of the hypothesis.
        at_s: since when, unix time.
        weight: log of the odds against nothing being wrong with it.
        evidence: what was seen, the strongest first.
        cell, pack: where, by index from 0; `judge` completes the pack of a cell.
    """

    code: str
    at_s: float
    weight: float
    evidence: tuple[Message, ...] = ()
    cell: int | None = None
    pack: int | None = None

    @property
    def place(self) -> tuple[int | None, int | None]:
        """Cell and pack."""
        return self.cell, self.pack


def pack_of(cell: int | None, segments: Sequence[int]) -> int | None:
    """Return the pack of a cell, from 0, of a battery with these segments."""
    return None if cell is None else bisect_right([*accumulate(segments)], cell)


_SLAVE = ("status", "com", "str")
_BOARD_FIELDS = tuple(f"slave[{pack}].{name}" for pack in range(N_PACKS) for name in _SLAVE)
_FAST = ("i_fs", "i_fc", "v", "t", "estimate.soc", "status.flags")
_CHARGER = ("charger.state", "charger.flags", "charger.fan_duty")
_FIELDS = (*_FAST, *_CHARGER, *_BOARD_FIELDS)
AT_ONCE = 0.5  # of the cells told in the same period: they are compared with each other
_DIE_V_PER_K = 7.5e-3  # LTC6804 data sheet: internal die temperature
_KELVIN = 273.0
_CODE_V = 1e-4


def read_recording(session: SessionFile, from_s: float, to_s: float) -> Recording:
    """Return what a session holds between two unix times."""
    found: dict[str, list[FieldSamples]] = defaultdict(list)
    battery, is_team = session.battery, session.loaded_battery.has_memory_map
    in_turns = session.loaded_battery.speaks_dbc is not None
    for piece in session.fields((*_FIELDS, IS_NEW) if in_turns else _FIELDS, from_s, to_s):
        for name, samples in piece.items():
            found[name].append(samples)
    time_s = np.concatenate([samples.time_s for samples in found["v"] or found["i_fs"]] or [np.empty(0)])

    def table(name: str, width: int = 1) -> FloatArray:
        return _onto(time_s, found[name], width)

    def column(name: str) -> FloatArray:
        return table(name)[:, 0]

    configs = [config for config in session.configs() if session.unix_s(config.t_mono_ns) <= to_s]
    image = configs[-1].image if configs else None
    return Recording(
        time_s=time_s,
        current_a=column("i_fs"),
        steady_a=column("i_fc" if is_team else "i_fs"),
        voltage_v=table("v", battery.n_cells),
        temperature_degc=table("t", battery.n_cells),
        soc=row_median(table("estimate.soc", battery.n_cells)),
        flags=_whole(column("status.flags")),
        charger_state=_whole(column("charger.state")),
        charger_flags=_whole(column("charger.flags")),
        fan_duty=column("charger.fan_duty"),
        boards=_boards(found, battery.n_segments),
        line=_line(session, from_s, to_s),
        bus=_bus(session, from_s, to_s, (image or default_image()) if is_team else None),
        events=read_events(session, from_s, to_s),
        limits=limits_over_time(session, from_s, to_s).at(to_s),
        start_s=session.info.started_wall_ns / 1e9,
        bits={name: k for k, name in enumerate(STATUS_FLAGS)},
        segments=battery.segments,
        is_together=not in_turns or _share_new(found[IS_NEW]) > AT_ONCE,
    )


def _share_new(parts: Sequence[FieldSamples]) -> float:
    """Of the cells' voltages in a row those that were told in it, on average; 0 where there are none."""
    return float(np.mean(np.concatenate([part.values for part in parts]))) if parts else 0.0


def _whole(values: FloatArray) -> IntArray:
    return np.where(np.isfinite(values), values, UNKNOWN).astype(np.int64)


def _onto(time_s: FloatArray, parts: Sequence[FieldSamples], width: int) -> FloatArray:
    """The latest row at each time, NaN before the first."""
    if not parts:
        return np.full((len(time_s), width), np.nan)
    own_s, values = np.concatenate([part.time_s for part in parts]), np.concatenate([part.values for part in parts])
    return latest_at(time_s, own_s, values)


def _boards(found: dict[str, list[FieldSamples]], n_packs: int) -> Boards:
    """A row for each round of the slow windows, which bring every board once; none of a battery without the master."""
    last = [part.time_s for part in found[f"slave[{n_packs - 1}].str"]]
    time_s = np.concatenate(last) if last else np.empty(0)

    def columns(name: str, element: int) -> FloatArray:
        of_packs = [
            _onto(time_s, _element(found[f"slave[{pack}].{name}"], element), 1)[:, 0] for pack in range(n_packs)
        ]
        return np.array(of_packs).T if len(time_s) else np.empty((0, n_packs))

    die = columns("str", 1)
    die = np.where((die == CHIP_MISSING) | (die <= 0), np.nan, die)
    return Boards(
        time_s=time_s,
        status=columns("status", 0),
        damaged=columns("com", 1),
        failed_tests=columns("com", 2),
        own_degc=die * _CODE_V / _DIE_V_PER_K - _KELVIN,
    )


def _element(parts: Sequence[FieldSamples], element: int) -> list[FieldSamples]:
    """One element where it arrived: a field may be cut where a slow window ends."""
    known = [np.isfinite(part.values[:, element]) for part in parts]
    return [
        FieldSamples(part.time_s[rows], part.values[rows, element : element + 1])
        for part, rows in zip(parts, known, strict=True)
    ]


def _line(session: SessionFile, from_s: float, to_s: float) -> LineTraffic:
    good, bad, lengths, usual = [], [], [], []
    for frame in session.frames(from_s, to_s):
        at_s = session.unix_s(frame.t_mono_ns)
        if frame.ok:
            good.append(at_s)
            usual.append(len(frame.raw))
        elif frame.raw:
            bad.append(at_s)
            lengths.append(len(frame.raw))
    typical = float(np.median(usual)) if usual else np.nan
    return LineTraffic(np.array(good), np.array(bad), np.array(lengths, dtype=np.float64) / typical)


def _bus(session: SessionFile, from_s: float, to_s: float, tables: bytes | None) -> BusTraffic:
    """What was on the bus; `tables` is the configuration of a master that speaks by it."""
    times: dict[int, list[float]] = defaultdict(list)
    for frame in session.can_frames(from_s, to_s):
        times[frame.can_id].append(session.unix_s(frame.t_mono_ns))
    arrivals = {can_id: np.array(at) for can_id, at in times.items()}
    if tables is None:
        return BusTraffic(arrivals, {}, None)
    sent = {
        tx.can_id | (CAN_ID_EXTENDED if tx.is_extended else 0): tx.period_ms / 1000
        for tx in tx_messages(tables)
        if tx.enabled and tx.period_ms
    }
    heard = [rx.can_id | (CAN_ID_EXTENDED if rx.is_extended else 0) for rx in rx_messages(tables) if rx.enabled]
    charger = STATUS_ID | CAN_ID_EXTENDED
    return BusTraffic(arrivals, sent, charger if charger in heard else None)


def read_events(session: SessionFile, from_s: float, to_s: float) -> list[Trigger]:
    """Return what was reported between two unix times; both times of a trigger are unix time."""
    found = []
    for event in session.events():
        at_s = session.unix_s(event["t_mono_ns"])
        if from_s <= at_s <= to_s:
            found.append(trigger_of_event(event, at_s, at_s))
    return found
