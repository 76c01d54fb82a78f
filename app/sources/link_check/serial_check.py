"""Check of a serial port: frames at the settings of a battery and at others, and the battery that they are of."""

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, get_args

from app.battery.serial import Parity, Port, SerialMapping
from app.sources.link_check.result import BATTERY_S, CHECK_S, POLL_S, SETTING_S, LinkCheck, Trial
from app.sources.links.profile_serial import Requests
from app.sources.links.serial import reason_of
from app.sources.links.serial_url import MASTER_PORT, check_url, open_port, set_port
from app.sources.serial.framing import frame_counter
from app.words import Message
from firmware_protocol.framing import Frame, FrameDecoder

BAUD_RATES = (115_200, 9_600, 19_200, 38_400, 57_600, 230_400, 460_800, 921_600)
_ADVICE = {"port-denied": Message("advice-denied"), "port-in-use": Message("advice-in-use")}


@dataclass(frozen=True, slots=True)
class _Listening:
    """Awaited frames of a battery, at settings of the port."""

    port: Port
    mapping: SerialMapping | None  # None: a master of ours
    battery: str | None = None
    seconds: float = CHECK_S
    asks: bool = True  # sends the battery's requests

    @property
    def setting(self) -> str:
        """The settings as people write them."""
        return setting_of(self.port)

    def counter(self) -> Callable[[bytes], int]:
        """Return a function that counts the frames in bytes as they are read."""
        if self.mapping is not None:
            return frame_counter(self.mapping)
        decoder = FrameDecoder()
        return lambda data: sum(isinstance(frame, Frame) for frame in decoder.feed(data))


def setting_of(port: Port) -> str:
    """Return settings as "115200 8E1"."""
    return f"{port.baud} {port.data_bits}{port.parity[0].upper()}{port.stop_bits:g}"


def has_settings(url: str) -> bool:
    """Return whether a port has a rate and a parity: a bare socket has none."""
    return not url.startswith("socket://")


def check_serial(
    url: str, mapping: SerialMapping | None = None, others: Mapping[str, SerialMapping | None] | None = None
) -> LinkCheck:
    """Open a port that a request names as the service would, and count what arrives.

    Without frames it is tried at other settings, and whether it is another battery. While the line is silent, the read
    requests of those are sent.

    Args:
        url: of the port.
        mapping: what is on the line; None: a master of ours.
        others: other batteries that it may be, by their id.

    Raises:
        ConfigError: it is none that a request may name.
    """
    check_url(url)
    own = _Listening(MASTER_PORT if mapping is None else mapping.port, mapping)
    trials: list[Trial] = []
    began_s = time.monotonic()
    try:
        port = open_port(url, POLL_S, own.port)
    except Exception as error:  # noqa: BLE001  drivers raise their own
        reason = reason_of(error, url)
        code = reason.code if isinstance(reason, Message) else ""
        return LinkCheck(url, error=reason, advice=_ADVICE.get(code, Message("advice-no-port")))
    try:
        best = _listen(port, own)
        trials.append(best)
        seconds = time.monotonic() - began_s
        for listening in (
            () if best.frames else _others(own, others or {}, has_bytes=best.bytes > 0, has_rate=has_settings(url))
        ):
            set_port(port, listening.port)
            trial = _listen(port, listening)
            trials.append(trial)
            if trial.frames:
                best, seconds = trial, listening.seconds
                break
    except Exception as error:  # noqa: BLE001  drivers raise their own
        received = sum(trial.bytes for trial in trials)
        return LinkCheck(
            url, bytes=received, error=reason_of(error, url), advice=Message("advice-no-port"), trials=tuple(trials)
        )
    finally:
        port.close()
    received = best.bytes if best.frames else max(trial.bytes for trial in trials)
    is_checked = best.battery is not None or mapping is None or mapping.has_checksum
    return LinkCheck(
        url,
        seconds,
        received,
        best.frames,
        advice=_advice(own, best, received),
        trials=tuple(trials),
        batteries=() if best.battery is None else (best.battery,),
        has_checksum=is_checked if best.frames else None,
    )


def _others(
    own: _Listening, batteries: Mapping[str, SerialMapping | None], *, has_bytes: bool, has_rate: bool
) -> Iterator[_Listening]:
    """Yield other settings where something arrives, then other batteries whose checksum proves them."""
    settings = [own.port]
    if has_bytes and has_rate:
        settings += [replace(own.port, parity=parity) for parity in get_args(Parity) if parity != own.port.parity]
        yield from (_Listening(port, own.mapping, seconds=SETTING_S, asks=False) for port in settings[1:])
    for name, mapping in batteries.items():
        if mapping != own.mapping and (mapping is None or mapping.has_checksum):
            port = MASTER_PORT if mapping is None else mapping.port
            yield _Listening(port, mapping, name, BATTERY_S, asks=not has_bytes)
    if has_bytes and has_rate:
        others = [replace(own.port, baud=rate) for rate in BAUD_RATES if rate != own.port.baud]
        yield from (_Listening(port, own.mapping, seconds=SETTING_S, asks=False) for port in others)


def _listen(port: Any, to: _Listening) -> Trial:
    requests = Requests(to.mapping) if to.mapping is not None and to.asks else None
    count, received, frames = to.counter(), 0, 0
    port.reset_input_buffer()
    if to.asks:
        port.write(to.port.start)
    end_s = time.monotonic() + to.seconds
    while (now_s := time.monotonic()) < end_s:
        if requests is not None and (request := requests.next(now_s)):
            port.write(request)
        data = bytes(port.read(max(1, port.in_waiting)))
        received += len(data)
        frames += count(data)
    if to.asks:
        with contextlib.suppress(Exception):
            port.write(to.port.stop)
    return Trial(to.setting, received, frames, battery=to.battery)


def _advice(own: _Listening, best: Trial, received: int) -> Message | None:
    if best.frames and best.battery is not None:
        return Message("advice-other-battery", setting=best.setting)
    if best.frames and best.setting != own.setting:
        return Message("advice-other-setting", setting=best.setting, own=own.setting)
    if best.frames:
        return None
    return Message("advice-no-frame", setting=own.setting) if received else Message("advice-silent")
