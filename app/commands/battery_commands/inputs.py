"""What the actions read: definitions of all DBCs of a profile, the frames of a log or of a bus."""

import sys
import time
from collections.abc import Iterable
from pathlib import Path

from app.battery.library import bundled_profiles, load_profile
from app.errors import ConfigError, LinkLost, message_of
from app.sources.dbc.dbc_file import load_definitions
from app.sources.dbc.definitions import Definitions
from app.sources.dbc.frames import Frames, TimedFrame, frames_of
from app.sources.dbc.log_file import load_log
from app.words import Message
from firmware_protocol.memory_map import CAN_ID_EXTENDED

_POLL_S = 0.2


def existing(field: str, path: Path) -> Path:
    """Return a file that is there.

    Raises:
        ConfigError: there is none.
    """
    if not path.is_file():
        raise ConfigError(field, path, "no such file")
    return path


def definitions_of(files: Iterable[Path]) -> Definitions:
    """Return the messages of files, the first one's first.

    Raises:
        ExtraMissing, ImportFailed: a file cannot be read.
        ConfigError: a file is missing.
    """
    found = Definitions(())
    for file in files:
        found = found.joined(load_definitions(existing("dbc", file)))
    return found


def bundled_definitions() -> dict[str, tuple[Path, ...]]:
    """Return the DBC files of each bundled profile that has some."""
    found = {}
    for name in bundled_profiles():
        try:
            files = load_profile(name).dbc_files
        except ConfigError:  # a part, no whole battery
            continue
        if files:
            found[name] = files
    return found


def log_frames(path: Path) -> Frames:
    """Return the frames of a log.

    Raises:
        ConfigError: there is no such file.
        ImportFailed: it cannot be read.
    """
    return load_log(existing("log", path))


def bus_frames(url: str, duration_s: float) -> Frames:
    """Listen to a bus and return what was heard.

    Raises:
        ConfigError: the bus is not INTERFACE:CHANNEL.
        LinkLost: the bus cannot be opened.
    """
    from app.sources.links.can import parse_bus
    from app.sources.links.python_can import can

    arguments = parse_bus(url)
    try:
        bus = can.Bus(**arguments)  # type: ignore[arg-type]
    except Exception as error:  # every driver raises its own
        raise LinkLost(Message("verbatim", text=str(message_of(error)))) from error
    found: list[TimedFrame] = []
    end_s = time.monotonic() + duration_s
    try:
        print(f"listening to {url} for {duration_s:g} s", file=sys.stderr)
        while time.monotonic() < end_s:
            message = bus.recv(_POLL_S)
            if message is not None and not (message.is_error_frame or message.is_remote_frame):
                can_id = message.arbitration_id | (CAN_ID_EXTENDED if message.is_extended_id else 0)
                found.append((time.monotonic_ns(), can_id, bytes(message.data)))
    except KeyboardInterrupt:
        pass
    finally:
        bus.shutdown()
    return frames_of(found)
