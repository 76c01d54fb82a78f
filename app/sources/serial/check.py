"""Checks of a battery's serial tables, and of captured bytes."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from app.battery.battery import Battery
from app.battery.serial import SerialFrame, SerialMapping
from app.sources.dbc.battery_decoder import ABSENT_DEGC, ChannelValues
from app.sources.dbc.check import ProfileIssue
from app.sources.dbc.log_check import listed
from app.sources.serial.checksums import checksum_of
from app.sources.serial.decoder import SerialDecoder
from app.sources.serial.framing import StreamReader
from app.words import Message, Quantity

MOST_CAPTURED = 64 << 20  # bytes of a file
_SUM_ERROR = 0.03
_BETWEEN = str.maketrans(":;.-", "    ")  # what a dump writes between bytes
_NUMBER = 4  # hex digits of a 16-bit number, as a line of text writes it
_CELL_V = (1.0, 5.0)


def serial_issues(battery: Battery, mapping: SerialMapping, file: str, capture: bytes | None) -> list[ProfileIssue]:
    """Return what is doubtful, errors first; `capture` are bytes that were read from the line, None without."""
    issues = []
    for i, part in enumerate(mapping.parts):
        checksum = part.checksum
        line = part.line if isinstance(part, SerialFrame) else part.row
        path = f"serial.{'frame' if isinstance(part, SerialFrame) else 'line'}[{i}]"
        if checksum is not None and checksum_of(checksum.kind) is None:
            issues.append(ProfileIssue(file, line, f"{path}.checksum", Message("serial-checksum"), is_error=True))
        if checksum is None:
            issues.append(ProfileIssue(file, line, path, Message("check-no-checksum", name=part.name)))
    if issues and any(issue.is_error for issue in issues):
        return sorted(issues, key=lambda issue: not issue.is_error)
    missing = _without_field(battery, mapping)
    if "voltage" not in mapping.kinds:
        issues.insert(0, ProfileIssue(file, None, "serial", Message("check-no-voltages"), is_error=True))
    elif missing:
        numbers = tuple(cell + 1 for cell in missing[:10])
        what = Message("check-without-signal", kind="voltage", n=len(missing), numbers=numbers)
        issues.append(ProfileIssue(file, None, "serial", what))
    if "current" not in mapping.kinds:
        issues.append(ProfileIssue(file, None, "serial", Message("check-no-current")))
    return issues if capture is None else [*issues, *_of_capture(battery, mapping, file, capture)]


def _without_field(battery: Battery, mapping: SerialMapping) -> list[int]:
    if any(field.index is not None or field.group for field in mapping.fields if field.kind == "voltage"):
        return []
    fields = [field for field in mapping.fields if field.kind == "voltage"]
    named = {cell for field in fields for cell in range(field.first, field.first + field.count)}
    return [cell for cell in range(battery.n_cells) if cell not in named]


def _of_capture(battery: Battery, mapping: SerialMapping, file: str, capture: bytes) -> list[ProfileIssue]:
    reader, decoder, values = _read(battery, mapping, capture)
    n_frames = reader.frames - decoder.implausible_frames
    what = Message("check-captured", n=n_frames, bad=reader.bad_frames, skipped=reader.skipped_bytes)
    issues = [] if n_frames and not reader.bad_frames else [ProfileIssue(file, None, "log", what)]
    if not n_frames:
        return issues
    for kind in sorted(mapping.kinds - values.keys()):
        issues.append(ProfileIssue(file, None, "log", Message("check-nothing-of-it", kind=kind)))
    if decoder.absent:
        issues.append(ProfileIssue(file, None, "log", _absent(battery, decoder, values.get("temperature"))))
    voltage = values.get("voltage")
    if voltage is not None:
        newest = np.full(battery.n_cells, np.nan)
        newest[voltage.index] = voltage.value
        odd = np.flatnonzero((newest < _CELL_V[0]) | (newest > _CELL_V[1]))
        if len(odd):
            worst = Quantity(float(newest[odd[0]]), "V", 3)
            numbers = tuple(int(cell) + 1 for cell in odd[:10])
            issues.append(
                ProfileIssue(file, None, "log", Message("check-implausible", n=len(odd), numbers=numbers, worst=worst))
            )
        pack = values.get("pack_voltage")
        total_v = float(newest.sum())
        if pack is not None and np.isfinite(total_v) and abs(pack.value[-1] - total_v) > _SUM_ERROR * abs(total_v):
            in_all, of_pack = Quantity(total_v, "V", 2), Quantity(float(pack.value[-1]), "V", 2)
            issues.append(ProfileIssue(file, None, "log", Message("check-sum-off", sum=in_all, pack=of_pack)))
    return issues


def _absent(battery: Battery, decoder: SerialDecoder, read: ChannelValues | None) -> Message:
    """The sensors of which nothing but values of absent ones came."""
    measured = set() if read is None else set(read.index[np.isfinite(read.value)].tolist())
    silent = [sensor for sensor in range(battery.n_sensors) if sensor not in measured]
    return Message("check-absent", n=len(silent), numbers=listed(silent), values=decoder.absent, degc=ABSENT_DEGC)


def shown_values(battery: Battery, mapping: SerialMapping, capture: bytes) -> list[str]:
    """Return a line for each kind of value in captured bytes: the newest of each channel."""
    reader, _, decoded = _read(battery, mapping, capture)
    lines = [f"{reader.frames} frames received, {reader.bad_frames} damaged, {reader.skipped_bytes} bytes skipped"]
    for kind, values in sorted(decoded.items()):
        newest = dict(zip(values.index.tolist(), values.value.tolist(), strict=True))
        lines.append(f"{kind}: " + " ".join(f"{newest[channel]:.4g}" for channel in sorted(newest)))
    return lines


def _read(
    battery: Battery, mapping: SerialMapping, capture: bytes
) -> tuple[StreamReader, SerialDecoder, dict[str, ChannelValues]]:
    """Read a capture, which has no times: frames that silence parts follow each other by their length."""
    length = next((frame.length for frame in mapping.frames if not frame.header), None)
    if length is None:
        return _read_pieces(battery, mapping, [capture])
    pieces = [
        [capture[:begin], *(capture[at : at + length] for at in range(begin, len(capture), length))]
        for begin in {0, len(capture) % length}
    ]
    return max((_read_pieces(battery, mapping, parts) for parts in pieces), key=lambda read: _n_sound(*read[:2]))


def _read_pieces(
    battery: Battery, mapping: SerialMapping, pieces: Sequence[bytes]
) -> tuple[StreamReader, SerialDecoder, dict[str, ChannelValues]]:
    reader, decoder = StreamReader(mapping), SerialDecoder(battery, mapping)
    frames = [frame for k, piece in enumerate(pieces) for frame in reader.feed(piece, k * reader.silence_ns)]
    return reader, decoder, decoder.decode([*frames, *reader.idle(len(pieces) * reader.silence_ns)])


def _n_sound(reader: StreamReader, decoder: SerialDecoder) -> int:
    return reader.frames - decoder.implausible_frames


def captured_bytes(path: Path, battery: Battery | None = None, mapping: SerialMapping | None = None) -> bytes:
    """Return the bytes of a capture: a binary file or lines of text, or those that its text in hex stands for.

    With a mapping, text that may be both is what gives more frames.

    Raises:
        OSError: it cannot be read.
        ValueError: it is too large.
    """
    data = path.read_bytes()
    if len(data) > MOST_CAPTURED:
        raise ValueError(f"{path} has more than {MOST_CAPTURED >> 20} MB")
    dumped = _from_hex(data)
    if dumped is None:
        return data
    if battery is None or mapping is None:
        return data if all(len(token) == _NUMBER for token in _tokens(data.decode("ascii"))) else dumped
    by_frames = ((_n_sound(*_read(battery, mapping, variant)[:2]), variant) for variant in (dumped, data))
    return max(by_frames, key=lambda variant: variant[0])[1]


def _from_hex(data: bytes) -> bytes | None:
    """What text in hex stands for, whatever is between its bytes; None where it is none."""
    try:
        return bytes.fromhex("".join(_tokens(data.decode("ascii"))))
    except ValueError:
        return None


def _tokens(text: str) -> list[str]:
    return re.sub(r"0[xX](?=[0-9a-fA-F]{2}\b)", "", text).replace(",", " ").translate(_BETWEEN).split()
