"""`voltwall battery learn --serial`: bytes of a serial line, and the profile that they suggest."""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from typing import TYPE_CHECKING

from app.commands.arguments import write_out
from app.errors import ConfigError

if TYPE_CHECKING:
    from app.battery.serial import SerialMapping

_POLL_S = 0.1


def run(args: argparse.Namespace) -> int:
    """Print what the bytes consist of and write the profile; 1 where none fits."""
    from app.battery.library import load_profile
    from app.sources.serial.check import captured_bytes
    from app.sources.serial.propose import fitting, profile_text, propose
    from app.sources.serial.propose_lines import ProposedHex, ProposedLine

    try:
        data = captured_bytes(args.capture) if args.capture is not None else _read(args)
    except (OSError, ValueError) as error:
        raise ConfigError(
            "capture", args.capture or args.serial, getattr(error, "strerror", None) or str(error)
        ) from error
    print(f"{len(data)} bytes", file=sys.stderr)
    mapping_name = fitting(data, _bundled())
    if mapping_name is not None:
        print(
            f"the bundled profile {mapping_name} fits: its checksums are correct. Set the number of your cells in it.",
            file=sys.stderr,
        )
        write_out(load_profile(mapping_name).text, args.out)
        return 0
    proposed = propose(data)
    if proposed is None:
        print("nothing in it comes again and again: another speed or parity, or nobody asks? (--baud, --parity, --ask)")
        return 1
    if isinstance(proposed, ProposedLine):
        print(f"{proposed.seen} lines of {proposed.columns} columns", file=sys.stderr)
    elif isinstance(proposed, ProposedHex):
        checksum = "no checksum (to confirm)" if proposed.checksum is None else proposed.checksum.kind
        print(f"{proposed.seen} lines of {proposed.length} bytes in hex, {checksum}", file=sys.stderr)
    else:
        checksum = "no checksum (to confirm)" if proposed.checksum is None else proposed.checksum.kind
        print(f"{proposed.seen} frames of {proposed.length} bytes, {checksum}", file=sys.stderr)
    if proposed.voltages is None:
        print("no values in the range of cell voltages found (to confirm)", file=sys.stderr)
    write_out(profile_text(proposed, args.name or "serial", args.baud), args.out)
    return 0 if proposed.voltages is not None else 1


def _read(args: argparse.Namespace) -> bytes:
    """Bytes of a port; with `--ask` the read requests of the bundled profiles are sent, one after the other."""
    from app.battery.serial import Port
    from app.sources.links.serial import reason_of
    from app.sources.links.serial_url import open_port
    from app.words import render

    requests = _requests() if args.ask else []
    data, k = bytearray(), 0
    try:
        with open_port(args.serial, _POLL_S, Port(args.baud, args.parity)) as port:
            if args.start:
                port.write(args.start.encode("latin-1"))
            end_s, ask_s = time.monotonic() + args.seconds, time.monotonic()
            while time.monotonic() < end_s:
                if requests and time.monotonic() >= ask_s:
                    port.write(requests[k % len(requests)])
                    k, ask_s = k + 1, time.monotonic() + 2 * _POLL_S
                data += port.read(max(1, port.in_waiting))
    except ConfigError:
        raise
    except Exception as error:  # drivers raise their own
        raise ConfigError("serial", args.serial, render(reason_of(error, args.serial))) from error
    return bytes(data)


def _requests() -> list[bytes]:
    return [part.poll for mapping in _bundled().values() for part in mapping.parts if part.poll]


def _bundled() -> dict[str, SerialMapping]:
    """The bundled serial profiles by name."""
    from app.battery.library import bundled_profiles
    from app.battery.table_reader import ProfileError
    from app.sources.loaded_battery import load_battery

    mappings: dict[str, SerialMapping] = {}
    for name in bundled_profiles():
        with contextlib.suppress(ProfileError):  # a part
            mapping = load_battery(name).serial
            mappings |= {} if mapping is None else {name: mapping}
    return mappings
