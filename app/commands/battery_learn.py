"""`voltwall battery learn`: what is received from a bus, and the profile that it suggests."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from app.commands import battery_learn_serial
from app.commands.arguments import Actions, described, existing, write_out
from app.commands.console import Progress
from app.errors import ConfigError
from app.sources.dbc.definitions import Definitions
from app.sources.recordings.buses import Buses
from app.words import Message, render
from app.words.render import number

if TYPE_CHECKING:
    from app.sources.dbc.frames import Frames
    from app.sources.dbc.infer.bus_survey import BusSurvey
    from app.sources.dbc.infer.inference import InferredProfile
    from app.sources.dbc.infer.profile_draft import CurrentValue

_MOST_ODDITIES = 10


def add_arguments(actions: Actions) -> None:
    """Declare the action."""
    learning = actions.add_parser(
        "learn",
        **described("create a profile from a DBC and a bus or log, or from serial bytes; exit code 1 if none fits"),
    )
    learning.add_argument(
        "--dbc", type=Path, action="append", default=[], metavar="FILE",
        help="message definitions: .dbc, .sym, .kcd, .arxml; repeatable (default: the bundled ones)",
    )  # fmt: skip
    source = learning.add_mutually_exclusive_group()
    source.add_argument("--log", type=Path, metavar="FILE", help="CAN log: .log (candump), .trc, .asc, .blf, .mf4")
    source.add_argument("--can", metavar="IF:CH", help="record from a bus: python-can INTERFACE:CHANNEL")
    source.add_argument("--serial", metavar="PORT", help="read a serial line: device, or socket://HOST:PORT")
    source.add_argument("--capture", type=Path, metavar="FILE", help="bytes of a serial line: binary, or hex as text")
    add_bus_argument(learning)
    learning.add_argument("--seconds", type=float, default=30.0, metavar="S", help="recording time (default: 30)")
    learning.add_argument("--baud", type=int, default=115_200, metavar="N", help="speed of the line (default: 115200)")
    learning.add_argument("--parity", choices=("none", "even", "odd"), default="none", help="parity (default: none)")
    learning.add_argument("--start", default="", metavar="TEXT", help="text that starts the stream, such as x")
    learning.add_argument("--ask", action="store_true", help="send the read requests of the bundled serial profiles")
    learning.add_argument("--name", default="", help="name of the battery (default: the name of the DBC)")
    learning.add_argument("--out", type=Path, metavar="FILE", help="file for the profile (default: standard output)")
    learning.add_argument("--signals", action="store_true", help="also list every signal with its range")
    learning.add_argument(
        "--with-states", action="store_true",
        help="include the proposed state signals (default: as comments to confirm)",
    )  # fmt: skip
    learning.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print what is received and write the profile; 1 where none fits."""
    if args.serial is not None or args.capture is not None:
        return battery_learn_serial.run(args)
    from app.battery.source import STATES
    from app.sources.dbc.frames import frames_of
    from app.sources.dbc.infer.inference import infer_profile
    from app.sources.dbc.infer.lines import Choice
    from app.sources.dbc.infer.profile_draft import ProfileDraft
    from app.sources.dbc.infer.profile_text import profile_text
    from app.sources.dbc.listening import bus_frames

    frames, buses = frames_of([]), Buses(args.bus)
    if args.log is not None:
        frames = log_frames(args.log, buses)
    elif args.can is not None:
        print(f"listening to {args.can} for {args.seconds:g} s", file=sys.stderr)
        frames = bus_frames(args.can, args.seconds)
    elif not args.dbc:
        raise ConfigError("dbc", "", "--dbc, --log, --can, --serial or --capture")
    definitions, files = (definitions_of(args.dbc), args.dbc) if args.dbc else _bundled(frames)
    if args.log is not None:
        buses.check(args.log.name, definitions.by_id())
    _print_oddities(definitions)
    draft = ProfileDraft(definitions, (), frames, "")
    survey = draft.survey
    _print_messages(survey, with_signals=args.signals)
    folder = Path() if args.out is None else args.out.parent
    names = tuple(_relative(file, folder) for file in files)
    confirmed = {f"state.{name}": Choice(is_taken=True) for name in STATES} if args.with_states else {}
    inferred = infer_profile(survey, frames, args.name or files[0].stem, names, confirmed)
    if inferred is None:
        print(render(Message("infer-nothing")))
        return 1
    text = profile_text(inferred)
    _print_summary(inferred, draft.running(inferred))
    for issue in draft.check(text):
        if issue.field != "DBC":
            print(f"  to check: {issue.field}: {render(issue.what)}")
    print()
    write_out(text, args.out)
    if args.out is not None:
        print(f"{args.out} written; read it, correct it, then: voltwall battery check {args.out}")
    return 0


def _bundled(frames: Frames) -> tuple[Definitions, list[Path]]:
    """The definitions that come along of which most frames are received."""
    import numpy as np

    from app.battery.library import bundled_profiles, load_profile

    best: tuple[int, Definitions, list[Path]] = (0, Definitions(()), [])
    for name in bundled_profiles():
        try:
            files = load_profile(name).dbc_files
        except ConfigError:  # a part, no whole battery
            continue
        definitions = definitions_of(files)
        received = int(np.isin(frames.can_id, np.array(list(definitions.by_id()), np.uint32)).sum())
        if received > best[0]:
            best = received, definitions, list(files)
    if not best[0]:
        raise ConfigError("dbc", "", "none of the frames is of a battery that is known here: say --dbc FILE")
    return best[1], best[2]


def _relative(file: Path, folder: Path) -> str:
    try:
        return Path(os.path.relpath(file, folder)).as_posix()
    except ValueError:  # another drive
        return file.as_posix()


def _print_oddities(definitions: Definitions) -> None:
    for oddity in definitions.oddities[:_MOST_ODDITIES]:
        place = oddity.file if oddity.line is None else f"{oddity.file}:{oddity.line}"
        print(f"{place}: {render(oddity.what)}")
    if len(definitions.oddities) > _MOST_ODDITIES:
        print(f"... and {len(definitions.oddities) - _MOST_ODDITIES} more: voltwall battery check lists all")


def _print_messages(survey: BusSurvey, with_signals: bool) -> None:
    messages = survey.definitions.by_id()
    if not survey.n_frames:
        print(f"{len(messages)} messages in the DBC; without --log or --can their values are unknown")
        return
    summary = f"{len(survey.received)} of {len(messages)} messages received"
    print(f"{survey.n_frames} frames in {survey.duration_s:.1f} s; {summary}")
    print(f"{'id':>10}  {'message':32} {'signals':>7} {'frames':>8} {'Hz':>8}")
    for can_id, received in sorted(survey.received.items()):
        message = received.message
        print(
            f"{_id(can_id):>10}  {message.name:32} {len(message.signals):>7} {len(received.group.frames):>8}"
            f" {number(received.rate_hz, 2):>8}"
        )
        for signal in message.signals if with_signals else ():
            values = received.signal(signal.name)
            if values is not None:
                print(f"{'':12}{signal.name}: {values.low:.6g} to {values.high:.6g} {signal.unit}")
    if survey.unknown:
        most = sorted(survey.unknown.items(), key=lambda item: -item[1])[:8]
        print(
            f"not in the DBC: {', '.join(f'{_id(i)} ({n})' for i, n in most)}"
            + (", ..." if len(survey.unknown) > 8 else "")
        )


def _id(can_id: int) -> str:
    return f"{can_id & 0x1FFFFFFF:08X}x" if can_id >> 31 else f"{can_id:03X}"


def _reading_of(key: str, running: CurrentValue | None) -> str:
    """What a line read last, for the line's end."""
    from app.sources.dbc.infer.lines import LINE_UNITS

    if running is None:
        return ""
    values = [value for value in running.values if value is not None]
    if not values:
        return ", not measured"
    if running.raw is not None:
        return f", now {running.raw} {running.text}".rstrip() + f": {'yes' if values[0] else 'no'}"
    if key == "soc":
        return f", now {100 * values[0]:.4g} %"
    unit = LINE_UNITS.get(key.partition(".")[0], "")
    if len(running.values) > 1:
        return f", now {min(values):.4g} to {max(values):.4g} {unit} of {len(values)}"
    return f", now {values[0]:.5g} {unit}"


def _print_summary(inferred: InferredProfile, running: dict[str, CurrentValue]) -> None:
    from app.sources.dbc.infer.lines import title

    battery = inferred.battery
    print(f"\nsuggested: {battery.n_cells} cells in {battery.n_packs} packs, {battery.n_sensors} temperature sensors")
    for key, line in inferred.lines.items():
        reads = _reading_of(key, running.get(key))
        print(f"  {key}: {title(line.chosen)}{reads}{'' if line.is_taken else '  (to confirm)'}")
        for reason in line.chosen.reasons:
            print(f"    {render(reason)}")
        others = [title(candidate) for candidate in line.candidates if title(candidate) != title(line.chosen)]
        if others:
            print(f"    or: {', '.join(others)}")
    for question in inferred.questions:
        print(f"  needs your input: {render(question)}")


def definitions_of(files: Iterable[Path]) -> Definitions:
    """Return the messages of files, the first one's first.

    Raises:
        ExtraMissing, ImportFailed: a file cannot be read.
        ConfigError: a file is missing.
    """
    from app.sources.dbc.dbc_file import load_definitions

    definitions = Definitions(())
    for file in files:
        definitions = definitions.joined(load_definitions(existing("dbc", file)))
    return definitions


def add_bus_argument(parser: argparse.ArgumentParser) -> None:
    """Declare --bus."""
    parser.add_argument("--bus", default="", metavar="BUS", help="bus of a log that has several, such as can0")


def log_frames(path: Path, buses: Buses) -> Frames:
    """Return the frames of a log; the terminal shows how far it is read.

    Raises:
        ConfigError: there is no such file.
        ImportFailed: it cannot be read.
    """
    from app.sources.dbc.frames import load_log

    size = existing("log", path).stat().st_size
    with Progress(path.name) as progress:
        return load_log(path, lambda at: progress(at, size), buses)
