"""A stretch of a session as the judge of causes reads it: cells, current, boards, charger, lines, events."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from app.analysis.incidents import Trigger, trigger_of_event
from app.analysis.limits import limits_over_time
from app.analysis.root_cause.recording import UNKNOWN, Boards, BusTraffic, IntArray, LineTraffic, SessionStretch
from app.battery.shape import N_PACKS
from app.estimation.arrays import FloatArray, latest_at, row_median
from app.sessions.reading.reader import SessionFile
from app.sessions.reading.series import FieldSamples
from app.sessions.storage.battery_fields import IS_NEW
from firmware_protocol.can_tables import rx_messages, tx_messages
from firmware_protocol.config_image import default_image
from firmware_protocol.elcon import STATUS_ID
from firmware_protocol.memory_map import CAN_ID_EXTENDED, CHIP_MISSING, STATUS_FLAGS

_SLAVE = ("status", "com", "str")
_BOARD_FIELDS = tuple(f"slave[{pack}].{name}" for pack in range(N_PACKS) for name in _SLAVE)
_FAST = ("i_fs", "i_fc", "v", "t", "estimate.soc", "status.flags")
_CHARGER = ("charger.state", "charger.flags", "charger.fan_duty")
_FIELDS = (*_FAST, *_CHARGER, *_BOARD_FIELDS)
AT_ONCE = 0.5  # share of cells measured in one period: these are compared with each other
_DIE_V_PER_K = 7.5e-3  # LTC6804 data sheet: internal die temperature
_KELVIN = 273.0
_CODE_V = 1e-4


def read_stretch(session: SessionFile, from_s: float, to_s: float) -> SessionStretch:
    """Return what a session holds between two unix times."""
    samples_of: dict[str, list[FieldSamples]] = defaultdict(list)
    battery, is_team = session.battery, session.loaded_battery.has_memory_map
    in_turns = session.loaded_battery.mapping is not None
    for piece in session.fields((*_FIELDS, IS_NEW) if in_turns else _FIELDS, from_s, to_s):
        for name, samples in piece.items():
            samples_of[name].append(samples)
    time_s = np.concatenate([samples.time_s for samples in samples_of["v"] or samples_of["i_fs"]] or [np.empty(0)])

    def table(name: str, width: int = 1) -> FloatArray:
        return _onto(time_s, samples_of[name], width)

    def column(name: str) -> FloatArray:
        return table(name)[:, 0]

    configs = [config for config in session.configs() if session.unix_s(config.t_mono_ns) <= to_s]
    image = configs[-1].image if configs else None
    return SessionStretch(
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
        boards=_boards(samples_of, battery.n_packs),
        line=_line(session, from_s, to_s),
        bus=_bus(session, from_s, to_s, (image or default_image()) if is_team else None),
        events=read_events(session, from_s, to_s),
        limits=limits_over_time(session, from_s, to_s).at(to_s),
        start_s=session.info.started_wall_ns / 1e9,
        bits={name: k for k, name in enumerate(STATUS_FLAGS)},
        segments=battery.segments,
        is_together=not in_turns or _share_new(samples_of[IS_NEW]) > AT_ONCE,
    )


def _share_new(parts: Sequence[FieldSamples]) -> float:
    """Of the cells' voltages in a row those that were measured in it, on average; 0 where there are none."""
    return float(np.mean(np.concatenate([part.values for part in parts]))) if parts else 0.0


def _whole(values: FloatArray) -> IntArray:
    return np.where(np.isfinite(values), values, UNKNOWN).astype(np.int64)


def _onto(time_s: FloatArray, parts: Sequence[FieldSamples], width: int) -> FloatArray:
    """The latest row at each time, NaN before the first."""
    if not parts:
        return np.full((len(time_s), width), np.nan)
    own_s, values = np.concatenate([part.time_s for part in parts]), np.concatenate([part.values for part in parts])
    return latest_at(time_s, own_s, values)


def _boards(samples: dict[str, list[FieldSamples]], n_packs: int) -> Boards:
    """A row for each round of the slow windows, which bring every board once; none of a battery without the master."""
    last = [part.time_s for part in samples[f"slave[{n_packs - 1}].str"]]
    time_s = np.concatenate(last) if last else np.empty(0)

    def columns(name: str, element: int) -> FloatArray:
        of_packs = [
            _onto(time_s, _element(samples[f"slave[{pack}].{name}"], element), 1)[:, 0] for pack in range(n_packs)
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
    are_finite = [np.isfinite(part.values[:, element]) for part in parts]
    return [
        FieldSamples(part.time_s[rows], part.values[rows, element : element + 1])
        for part, rows in zip(parts, are_finite, strict=True)
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
    """What was on the bus; `tables` is the configuration of a master that sends by it."""
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
    received = [rx.can_id | (CAN_ID_EXTENDED if rx.is_extended else 0) for rx in rx_messages(tables) if rx.enabled]
    charger = STATUS_ID | CAN_ID_EXTENDED
    return BusTraffic(arrivals, sent, charger if charger in received else None)


def read_events(session: SessionFile, from_s: float, to_s: float) -> list[Trigger]:
    """Return what was reported between two unix times; both times of a trigger are unix time."""
    triggers = []
    for event in session.events():
        at_s = session.unix_s(event["t_mono_ns"])
        if from_s <= at_s <= to_s:
            triggers.append(trigger_of_event(event, at_s, at_s))
    return triggers
