"""Check of a CAN bus: frames by bit rate, and the batteries whose messages these are.

An adapter that acknowledges at a wrong rate destroys every frame of the bus: other rates are tried only where the
adapter listens only. A battery that is alone with such an adapter is never acknowledged, and nobody receives it: where
a person says that it is alone, the rates are tried acknowledging.
"""

import re
import time
from collections import Counter
from collections.abc import Mapping
from typing import Any

from app.sources.dbc.definitions import Definitions
from app.sources.dbc.parts import is_present
from app.sources.link_check.result import CHECK_S, POLL_S, LinkCheck, Trial
from app.sources.links.can import COUNTING
from app.sources.links.can_bus import DEFAULT_BIT_RATE, Value, bus_reason, can, open_bus, parse_bus
from app.words import Message
from firmware_protocol.memory_map import CAN_ID_EXTENDED

BIT_RATES = (500_000, 250_000, 1_000_000, 125_000)
LISTEN_ONLY: Mapping[str, Mapping[str, Any]] = {  # how python-can opens an interface so that it never acknowledges
    "cantact": {"monitor": True},
    "kvaser": {"driver_mode": False},
    "nixnet": {"listen_only": True},
    "pcan": {"state": can.BusState.PASSIVE},
    "seeedstudio": {"operation_mode": "silent"},
    "slcan": {"listen_only": True},
    "systec": {"state": can.BusState.PASSIVE},
    "vector": {"listen_only": True},
}
RATE_BY_SYSTEM = ("socketcan", "socketcand", "virtual", "udp_multicast")  # the bit rate is set elsewhere, or none is
_SETTLE_S = 0.1  # for frames of the rate before
_Seen = Counter[tuple[int, int]]  # id with bit 31 for 29-bit ones, length


def check_can(url: str, batteries: Mapping[str, Definitions] | None = None, *, is_alone: bool = False) -> LinkCheck:
    """Open a bus that a request names, listen, and count its frames; try other bit rates where the adapter may.

    Args:
        url: of the bus.
        batteries: message definitions of batteries and parts that it may carry, by their id.
        is_alone: the battery is the only other node, and has to be acknowledged.

    Raises:
        ConfigError: it is none that a request may name.
    """
    arguments = parse_bus(url)
    interface = str(arguments["interface"])
    tries = interface in LISTEN_ONLY or (is_alone and interface not in RATE_BY_SYSTEM)
    rates = _rates(arguments) if tries else (None if interface in RATE_BY_SYSTEM else arguments["bitrate"],)
    opened = {**arguments, **({} if is_alone else LISTEN_ONLY.get(interface, {}))}
    trials: list[Trial] = []
    seen: _Seen = Counter()
    rate: Value | None = None
    seconds = CHECK_S
    bus: can.BusABC | None = None
    try:
        for rate in rates:
            bus = _at_rate(bus, opened, rate)
            began_s = time.monotonic()
            seen, errors = _listen(bus)
            seconds = time.monotonic() - began_s
            trials.append(_trial(rate, seen, errors if interface in COUNTING else None))
            if seen:
                break
    except Exception as error:  # noqa: BLE001  every driver raises its own
        advice = Message("advice-can-open")
        return LinkCheck(url, seconds, error=bus_reason(error, url), advice=advice, trials=tuple(trials))
    finally:
        if bus is not None:
            bus.shutdown()
    best = trials[-1]
    return LinkCheck(
        with_bit_rate(url, rate) if seen and tries else url,
        seconds,
        best.bytes,
        best.frames,
        advice=None if seen else _advice(interface, is_alone=is_alone),
        trials=tuple(trials),
        batteries=_batteries(seen, batteries or {}),
    )


def without_bit_rate(url: str) -> str:
    """Return a bus without the bit rate that it names."""
    bare = re.sub(r"[?&]bitrate=[^&]*", "", url)
    return bare.replace("&", "?", 1) if "?" not in bare else bare


def is_same_bus(url: str, other: str | None) -> bool:
    """Return whether two URLs name the same bus, at any bit rate."""
    return other is not None and without_bit_rate(url) == without_bit_rate(other)


def with_bit_rate(url: str, rate: Value | None) -> str:
    """Return a bus with its bit rate, in place of one that it names."""
    bare = without_bit_rate(url)
    return f"{bare}{'&' if '?' in bare else '?'}bitrate={rate}"


def _rates(arguments: Mapping[str, Value]) -> tuple[Value, ...]:
    first = arguments.get("bitrate", DEFAULT_BIT_RATE)
    return (first, *(rate for rate in BIT_RATES if rate != first))


def _at_rate(bus: can.BusABC | None, arguments: Mapping[str, Any], rate: Value | None) -> can.BusABC:
    """The bus at a rate; slcan changes it, and every other adapter is opened again."""
    if bus is not None and hasattr(bus, "set_bitrate"):
        bus.set_bitrate(rate)
        end_s = time.monotonic() + _SETTLE_S
        while time.monotonic() < end_s:
            bus.recv(0.01)
        return bus
    if bus is not None:
        bus.shutdown()
    return open_bus({**arguments, **({} if rate is None else {"bitrate": rate})})


def _listen(bus: can.BusABC) -> tuple[_Seen, int]:
    seen: _Seen = Counter()
    errors = 0
    end_s = time.monotonic() + CHECK_S
    while time.monotonic() < end_s:
        message = bus.recv(POLL_S)
        if message is not None and message.is_error_frame:
            errors += 1
        elif message is not None:
            can_id = message.arbitration_id | (CAN_ID_EXTENDED if message.is_extended_id else 0)
            seen[can_id, len(message.data)] += 1
    return seen, errors


def _trial(rate: Value | None, seen: _Seen, errors: int | None) -> Trial:
    setting = "" if rate is None else f"{float(rate) / 1000:g} kbit/s"
    return Trial(setting, sum(length * n for (_, length), n in seen.items()), seen.total(), errors)


def _batteries(seen: _Seen, batteries: Mapping[str, Definitions]) -> tuple[str, ...]:
    """Those of which most messages came; the one with most of them first."""
    ids = {can_id for can_id, _ in seen}
    present = []
    for name, definitions in batteries.items():
        if is_present(definitions, ids):
            present.append((-len(ids & definitions.by_id().keys()), name))
    return tuple(name for _, name in sorted(present))


def _advice(interface: str, *, is_alone: bool) -> Message:
    if interface in RATE_BY_SYSTEM:
        return Message("advice-can-system-rate")
    if is_alone:
        return Message("advice-can-no-rate")
    if interface in LISTEN_ONLY:
        return Message("advice-can-unacknowledged")
    return Message("advice-can-not-listening-only", interface=interface)
