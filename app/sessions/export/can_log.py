"""The recorded CAN frames as logs that other CAN tools read, by python-can: candump, Vector ASC and BLF."""

from collections.abc import Callable, Iterable
from pathlib import Path

from app.errors import ConfigError
from app.sessions.export.table import SignalTable
from app.sources.items import CanItem
from app.sources.links.can_bus import can
from app.sources.recordings.origin import SIMULATED_CHANNEL, SIMULATED_MARK
from app.words import Message
from firmware_protocol.memory_map import CAN_ID_EXTENDED

ID_BITS = 0x1FFFFFFF
CHANNEL = "can0"
PROGRESS_EVERY = 1000  # frames
Writer = can.CanutilsLogWriter | can.ASCWriter | can.BLFWriter


def write_candump(table: SignalTable, path: Path) -> None:
    """Write what `candump -L` would have written."""
    with can.CanutilsLogWriter(str(path)) as writer:
        _write(table, writer, SIMULATED_CHANNEL if table.is_simulated else CHANNEL)


def write_asc(table: SignalTable, path: Path) -> None:
    """Write a Vector ASC file."""
    with can.ASCWriter(str(path)) as writer:
        _write(table, writer, 0)


def write_blf(table: SignalTable, path: Path) -> None:
    """Write a Vector BLF file."""
    with can.BLFWriter(str(path)) as writer:
        _write(table, writer, 0)


def write_items(
    write: Callable[[Path], Writer], path: Path, items: Iterable[CanItem], *, is_simulated: bool = False
) -> None:
    """Write frames that are in memory; `write` opens one of LOG_FORMATS."""
    channel = SIMULATED_CHANNEL if is_simulated else CHANNEL
    with write(path) as writer:
        for number, item in enumerate(items):
            if is_simulated and not number:
                _mark_simulated(writer, item.t_wall_ns / 1e9)
            message = can.Message(
                timestamp=item.t_wall_ns / 1e9,
                arbitration_id=item.can_id & ID_BITS,
                is_extended_id=bool(item.can_id & CAN_ID_EXTENDED),
                data=item.data,
                channel=channel if isinstance(writer, can.CanutilsLogWriter) else 0,
                is_rx=not item.sent,
            )
            writer.on_message_received(message)


LOG_FORMATS: dict[str, tuple[str, Callable[[Path], Writer]]] = {
    "candump": (".log", lambda path: can.CanutilsLogWriter(str(path))),
    "asc": (".asc", lambda path: can.ASCWriter(str(path))),
    "blf": (".blf", lambda path: can.BLFWriter(str(path))),
}


def _channel(first: str | int, bus: int) -> str | int:
    """The channel of a frame's bus; all buses of a simulated car are marked as such."""
    if isinstance(first, int):
        return first + bus
    return first if first != CHANNEL else f"{CHANNEL[:-1]}{bus}"


def _mark_simulated(writer: Writer, first_s: float) -> None:
    """Write at the time of the first frame that the car is simulated; candump has no events, its channel says it."""
    if not isinstance(writer, can.CanutilsLogWriter):
        writer.log_event(SIMULATED_MARK, first_s)


def _write(table: SignalTable, writer: Writer, channel: str | int) -> None:
    """Write the frames of the table's range; its signals have no part in it.

    Raises:
        ConfigError: there is none.
    """
    session = table.session
    n_frames = session.count_can_frames(table.t_from_s, table.t_to_s)
    if not n_frames:
        raise ConfigError("session", session.info.id, Message("with-can-frames"))
    for number, frame in enumerate(session.can_frames(table.t_from_s, table.t_to_s, all_buses=True), 1):
        time_s = session.unix_s(frame.t_mono_ns)
        if table.is_simulated and number == 1:
            _mark_simulated(writer, time_s)
        message = can.Message(
            timestamp=time_s,
            arbitration_id=frame.can_id & ID_BITS,
            is_extended_id=bool(frame.can_id & CAN_ID_EXTENDED),
            data=frame.data,
            channel=_channel(channel, frame.bus),
        )
        writer.on_message_received(message)
        if number % PROGRESS_EVERY == 0:
            table.on_progress(min(number, n_frames), n_frames)
    table.on_progress(n_frames, n_frames)
