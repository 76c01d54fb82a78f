"""Hypotheses about the master's supply, its memory, its links RS232 and CAN, the slave boards and the charger."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from app.analysis.root_cause.recording import Hypothesis, SessionStretch, pack_of_event
from app.estimation.arrays import BoolArray, FloatArray
from app.words import Message, Pack, Quantity
from firmware_protocol.elcon import ChargerFlags
from firmware_protocol.memory_map import CHARGER_STATES

SETTLED_S: Final = 4.0  # a boot this soon after the start is the start
SILENT_S: Final = 2.0
BUS_SILENT_S: Final = 3.0  # a service that is held up receives one link later than the other
CUT_LENGTH: Final = 0.85  # share of a good frame's length; shorter damaged frames broke off
FLOOD_PER_S: Final = 1500.0  # frames of one foreign identifier
BOOTS: Final = {
    "boot-watchdog": "master-watchdog-reset",
    "boot-brown-out": "master-supply-lost",
    "boot-power-on": "master-supply-lost",
}


def link_hypotheses(recording: SessionStretch) -> Iterator[Hypothesis]:
    """Yield what restarts, silences and damaged frames show."""
    yield from _restarts(recording)
    yield from _memory(recording)
    yield from _line(recording)
    yield from _bus(recording)


def _restarts(recording: SessionStretch) -> Iterator[Hypothesis]:
    for event in recording.events:
        if event.code != "boot" or event.at_s - recording.start_s < SETTLED_S or isinstance(event.message, str):
            continue
        cause = event.message.args.get("cause")
        code = BOOTS.get(cause.code) if isinstance(cause, Message) else None
        if code is not None and isinstance(cause, Message):
            yield Hypothesis(code, event.at_s - 6.0, 80.0, (Message("seen-boot", cause=cause),))


def _memory(recording: SessionStretch) -> Iterator[Hypothesis]:
    off = np.flatnonzero(recording.bit("i2c1") == 0.0)
    if off.size >= 5:
        yield Hypothesis("eeprom-worn", float(recording.time_s[off[0]]), 40.0, (Message("seen-eeprom-flag"),))


def _gaps(times_s: FloatArray, from_s: float, to_s: float, least_s: float) -> list[tuple[float, float]]:
    """Silences of `least_s` and more between two instants."""
    edges = np.concatenate(([from_s], times_s[(times_s >= from_s) & (times_s <= to_s)], [to_s]))
    wide = np.flatnonzero(np.diff(edges) >= least_s)
    return [(float(edges[k]), float(edges[k + 1])) for k in wide]


def _line(recording: SessionStretch) -> Iterator[Hypothesis]:
    line, bus = recording.line, recording.bus
    total = line.good_s.size + line.bad_s.size
    if line.bad_s.size >= 3 and line.bad_s.size / max(total, 1) > 1e-3:
        is_cut = float(np.median(line.bad_length)) < CUT_LENGTH
        share = Quantity(100 * line.bad_s.size / total, "%", 1)
        n = int(line.bad_s.size)
        if is_cut:
            yield Hypothesis(
                "serial-drop-outs", float(line.bad_s[0]), 40.0, (Message("seen-cut-frames", n=n, share=share),)
            )
        else:
            evidence = (Message("seen-damaged-frames", n=n, share=share),)
            yield Hypothesis("serial-noise", float(line.bad_s[0]), 40.0, evidence)
    if not total:
        return
    of_master = [times for can_id, times in bus.times_s.items() if can_id in bus.master_period_s]
    received = np.sort(np.concatenate(of_master)) if of_master else np.empty(0)
    end_s = max(recording.end_s, float(received[-1]) if received.size else 0.0)
    every = np.sort(np.concatenate((line.good_s, line.bad_s)))
    for from_s, to_s in _gaps(every, float(every[0]), end_s, SILENT_S):
        others = ((received > from_s) & (received < to_s)).sum()
        if others > 3:
            length = Quantity(to_s - from_s, "s", 0)
            yield Hypothesis("serial-silent", from_s, 50.0, (Message("seen-serial-silent", length=length),))
            return


def _bus(recording: SessionStretch) -> Iterator[Hypothesis]:
    bus, line = recording.bus, recording.line
    if not bus.times_s:
        return
    known_ids = {*bus.master_period_s, *([] if bus.charger_id is None else [bus.charger_id])}
    foreign = {can_id: times for can_id, times in bus.times_s.items() if can_id not in known_ids}
    for can_id, times in foreign.items():
        per_s = np.bincount(np.floor(times - times[0]).astype(int))
        if (per_s > FLOOD_PER_S).any() and can_id & 0x1FFFFFFF < min(can_id & 0x1FFFFFFF for can_id in known_ids):
            at_s = float(times[0] + np.flatnonzero(per_s > FLOOD_PER_S)[0])
            evidence = (Message("seen-can-flood", identifier=f"{can_id:X}", n=int(per_s.max())),)
            yield Hypothesis("can-babbling-node", at_s, 80.0, evidence)
            return
    errors = [event for event in recording.events if event.code == "can-error-frames"]
    silence = _silence_of_master(recording)
    if silence is not None:
        from_s, to_s = silence
        length = Quantity(to_s - from_s, "s", 0)
        charger = bus.times_s.get(bus.charger_id or -1, np.empty(0))
        talked = ((charger < from_s) & (charger > from_s - 5.0)).any()
        talks = ((charger > from_s + 1.5) & (charger < to_s)).sum() >= 1
        code, seen = "can-master-silent", Message("seen-can-master-silent", length=length)
        if talks:
            code, seen = "can-master-bus-off", Message("seen-can-master-bus-off", length=length)
        elif talked:
            code, seen = "can-silent", Message("seen-can-silent", length=length)
        reasons: tuple[Message, ...] = (seen,)
        if any(from_s - 2.0 <= event.at_s <= to_s for event in errors):
            code = "can-silent"
            reasons = (*reasons, Message("seen-can-errors"))
        yield Hypothesis(code, from_s, 60.0, reasons)
        if to_s - from_s > 5.0:
            return
    if len(errors) >= 2 and line.good_s.size:
        yield Hypothesis("can-noise", errors[0].at_s, 30.0, (Message("seen-can-errors"),))


def _silence_of_master(recording: SessionStretch) -> tuple[float, float] | None:
    """The first silence of a message that the master sends by its tables while RS232 says that it runs."""
    bus, line = recording.bus, recording.line
    for can_id, period_s in bus.master_period_s.items():
        times = bus.times_s.get(can_id)
        if times is None or not line.good_s.size:
            continue
        for from_s, to_s in _gaps(times, float(times[0]), float(line.good_s[-1]), max(5 * period_s, BUS_SILENT_S)):
            alive = (line.good_s > from_s + period_s) & (line.good_s < to_s)
            if alive.sum() > 0.6 * (to_s - from_s) / 0.1 - 5 and alive.sum() >= 5:
                return from_s, to_s
    return None


CONVERTER_BITS: Final = 1 | 2 | 4  # cells, auxiliary, status: what is converted is wrong
MULTIPLEXER_BIT: Final = 8


def board_hypotheses(recording: SessionStretch) -> Iterator[Hypothesis]:
    """Yield what the boards' own tests, their silence and their damaged packets show."""
    noisy = list(_isospi(recording))
    yield from noisy
    yield from _self_tests(recording)
    yield from _silent(recording, is_noisy=bool(noisy))


def _isospi(recording: SessionStretch) -> Iterator[Hypothesis]:
    damaged = np.nan_to_num(recording.boards.damaged)
    rows = np.flatnonzero((damaged > 0).sum(axis=1) >= 2)
    if rows.size < 2 and not (rows.size and damaged[rows].sum() > 20):
        return
    packs = int((damaged[rows].max(axis=0) > 0).sum())
    evidence = (Message("seen-damaged-packets", n=round(float(damaged[rows].sum(axis=1).mean())), packs=packs),)
    yield Hypothesis("isospi-noise", float(recording.boards.time_s[rows[0]]) - 2.0, 30.0 + rows.size, evidence)


def _self_tests(recording: SessionStretch) -> Iterator[Hypothesis]:
    boards = recording.boards
    failed = np.nan_to_num(boards.failed_tests).astype(np.int64)
    for pack in np.flatnonzero(failed.any(axis=0)):
        rows = np.flatnonzero(failed[:, pack])
        bits = int(np.bitwise_or.reduce(failed[rows, pack]))
        code, seen = "slave-reference-drift", Message("seen-reference-test", pack=Pack(int(pack)))
        if bits & CONVERTER_BITS:
            code, seen = "slave-adc-fault", Message("seen-converter-test", pack=Pack(int(pack)))
        elif bits & MULTIPLEXER_BIT:
            code, seen = "slave-multiplexer-fault", Message("seen-multiplexer-test", pack=Pack(int(pack)))
        at_s = float(boards.time_s[rows[0]]) - 3.0  # a round of the slow windows and of the tests before
        yield Hypothesis(code, at_s, 60.0, (seen,), pack=int(pack))


def _silent(recording: SessionStretch, *, is_noisy: bool) -> Iterator[Hypothesis]:
    if not recording.time_s.size:
        return
    lost = [event for event in recording.events if event.code == "trip-slave-lost"]
    missing: BoolArray = np.logical_and.reduceat(np.isnan(recording.voltage_v), recording.pack_starts, axis=1)
    if not recording.is_together:  # what comes later in the first round is awaited
        missing &= np.logical_or.accumulate(~missing, axis=0) | missing.all(axis=0)
    tested = (np.nan_to_num(recording.boards.failed_tests) != 0).any(axis=0)
    packs = {pack for event in lost if (pack := pack_of_event(event, recording.segments)) is not None}
    if not missing.all(axis=1).any():
        packs |= {int(pack) for pack in np.flatnonzero(missing.sum(axis=0) >= 5) if not tested[pack]}
    for pack in sorted(packs):
        rows = np.flatnonzero(missing[:, pack])
        at_s = float(recording.time_s[rows[0]]) if rows.size else lost[0].at_s
        weight = 10.0 if is_noisy else 60.0
        yield Hypothesis("slave-lost", at_s, weight, (Message("seen-slave-silent", pack=Pack(pack)),), pack=pack)


FAULT: Final = CHARGER_STATES.index("fault")
ACTIVE: Final = tuple(CHARGER_STATES.index(name) for name in ("constant_current", "constant_voltage", "balancing"))
NOT_RECEIVED: Final = 255
BEFORE_S: Final = 3.0
BY_FLAG: Final = (
    (ChargerFlags.HARDWARE, "charger-hardware-fault", Message("seen-charger-broken")),
    (ChargerFlags.OVER_TEMPERATURE, "charger-over-temperature", Message("seen-charger-hot")),
    (ChargerFlags.INPUT_VOLTAGE, "charger-input-voltage", Message("seen-charger-no-mains")),
    (ChargerFlags.BATTERY, "charger-no-battery", Message("seen-charger-reversed")),
)


def charger_hypotheses(recording: SessionStretch) -> Iterator[Hypothesis]:
    """Yield why charging ended by itself."""
    state = recording.charger_state
    ended = np.flatnonzero((state[1:] == FAULT) & np.isin(state[:-1], ACTIVE)) + 1
    for row in ended:
        at_s = float(recording.time_s[row])
        near = recording.near(at_s - BEFORE_S, at_s + 1.0)
        flags = [value for value in recording.charger_flags[near].tolist() if value not in (-1, NOT_RECEIVED)]
        fault = next(((code, seen) for flag, code, seen in BY_FLAG if any(value & flag for value in flags)), None)
        if fault is not None:
            code, seen = fault
            yield Hypothesis(code, at_s - BEFORE_S, 60.0, (seen,))
        elif any(e.code == "can-rx-timeout" and abs(e.at_s - at_s) < 2.0 for e in recording.events):
            yield Hypothesis("charger-silent", at_s - 8.0, 40.0, (Message("seen-charger-silent"),))
