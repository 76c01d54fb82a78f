"""Samples of the master in recorded frames: limited values and OK signal, on the master's own clock."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.errors import DecodeError
from firmware_protocol.framing import BITS_PER_BYTE, Frame, decode_chunk
from firmware_protocol.memory_map import FIELDS, STATUS_FLAGS
from firmware_protocol.messages import Data, EventMessage, Window, decode_message

_WRAP_MS = 1 << 32
_DELIMITERS = 2
_OK, _LOAD = (1 << STATUS_FLAGS.index(name) for name in ("fit", "load"))
_WANTED = ("status.flags", "i_fs", "i_fc", "v", "t")


@dataclass(frozen=True, slots=True, eq=False)
class SampledValues:
    """The values of a fast frame, in the counts of the memory map, all copied at one instant."""

    is_ok: bool  # the OK signal: off opens the shutdown circuit
    is_loaded: bool  # the relays connect the vehicle
    current: tuple[int, int]  # latest and averaged [10 mA]
    voltage: NDArray[np.uint16]  # (cells,) [100 uV], 0 missing
    temperature: NDArray[np.int8]  # (cells,) [degC], -128 missing


@dataclass(frozen=True, slots=True, eq=False)
class MasterSample:
    """One frame: when the master copied it, when it came here; `values` of a fast frame, `event` of an event."""

    uptime_ms: int
    boot: int  # counts up where the master's clock starts again
    sequence: int
    arrived_ns: int
    line_s: float  # that it took on the line
    values: SampledValues | None = None
    event: EventMessage | None = None


def master_samples(frames: Iterable[tuple[int, bytes]], baud_rate: int) -> list[MasterSample]:
    """A sample for every intact frame, in order of arrival; `frames` are (arrival [ns], bytes between delimiters).

    Args:
        frames: as recorded, good and bad ones.
        baud_rate: of the line, for the time that a frame takes on it.
    """
    samples: list[MasterSample] = []
    boot = wraps = 0
    for arrived_ns, raw in frames:
        frame = decode_chunk(raw)
        if not isinstance(frame, Frame):
            continue
        uptime_ms = frame.uptime_ms + wraps * _WRAP_MS
        if samples and uptime_ms < samples[-1].uptime_ms:
            is_wrap = samples[-1].uptime_ms - uptime_ms > _WRAP_MS // 2
            wraps = wraps + 1 if is_wrap else 0
            boot += not is_wrap
            uptime_ms = frame.uptime_ms + wraps * _WRAP_MS
        line_s = (len(raw) + _DELIMITERS) * BITS_PER_BYTE / baud_rate
        values, event = _meaning(frame)
        samples.append(MasterSample(uptime_ms, boot, frame.sequence, arrived_ns, line_s, values, event))
    return samples


def _meaning(frame: Frame) -> tuple[SampledValues | None, EventMessage | None]:
    try:
        message = decode_message(frame)
    except DecodeError:
        return None, None
    if isinstance(message, EventMessage):
        return None, message
    return (_values(message.windows) if isinstance(message, Data) else None), None


def _values(windows: Iterable[Window]) -> SampledValues | None:
    """Return the values of a frame that has them all, None of a slow one."""
    values = {}
    for name in _WANTED:
        field = FIELDS[name]
        for offset, data in windows:
            if offset <= field.offset and field.offset + field.size <= offset + len(data):
                values[name] = data[field.offset - offset : field.offset - offset + field.size]
                break
        else:
            return None
    flags = int.from_bytes(values["status.flags"], "little")
    i_fs, i_fc = (int.from_bytes(values[name], "little", signed=True) for name in ("i_fs", "i_fc"))
    return SampledValues(
        is_ok=bool(flags & _OK),
        is_loaded=bool(flags & _LOAD),
        current=(i_fs, i_fc),
        voltage=np.frombuffer(values["v"], "<u2"),
        temperature=np.frombuffer(values["t"], "i1"),
    )
