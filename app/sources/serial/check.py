"""Checks of a battery's serial tables, and of captured bytes."""

import re
from pathlib import Path

import numpy as np

from app.battery.battery import Battery
from app.battery.serial import SerialFrame, SerialMapping
from app.sources.dbc.check import ProfileIssue
from app.sources.serial.checksums import checksum_of
from app.sources.serial.decoder import SerialDecoder
from app.sources.serial.framing import StreamReader
from app.words import Message, Quantity

MOST_CAPTURED = 64 << 20  # bytes of a file
_SUM_ERROR = 0.03
_CELL_V = (1.0, 5.0)


def serial_issues(battery: Battery, mapping: SerialMapping, file: str, capture: bytes | None) -> list[ProfileIssue]:
    """Return what is doubtful, errors first; `capture` are bytes that were read from the line, None without."""
    issues = []
    for i, part in enumerate(mapping.parts):
        checksum = part.checksum if isinstance(part, SerialFrame) else None
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
    reader, decoder = StreamReader(mapping), SerialDecoder(battery, mapping)
    frames = reader.feed(capture, 0)
    values = decoder.decode([*frames, *reader.idle(reader.silence_ns)])
    n_frames = reader.frames - decoder.implausible_frames
    what = Message("check-captured", n=n_frames, bad=reader.bad_frames, skipped=reader.skipped_bytes)
    issues = [] if n_frames and not reader.bad_frames else [ProfileIssue(file, None, "log", what)]
    if not n_frames:
        return issues
    for kind in sorted(mapping.kinds - values.keys()):
        issues.append(ProfileIssue(file, None, "log", Message("check-nothing-of-it", kind=kind)))
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


def shown_values(battery: Battery, mapping: SerialMapping, capture: bytes) -> list[str]:
    """Return a line for each kind of value in captured bytes: the newest of each channel."""
    reader, decoder = StreamReader(mapping), SerialDecoder(battery, mapping)
    frames = reader.feed(capture, 0)
    lines = [f"{reader.frames} frames, {reader.bad_frames} bad, {reader.skipped_bytes} bytes skipped"]
    for kind, values in sorted(decoder.decode([*frames, *reader.idle(reader.silence_ns)]).items()):
        newest = dict(zip(values.index.tolist(), values.value.tolist(), strict=True))
        lines.append(f"{kind}: " + " ".join(f"{newest[channel]:.4g}" for channel in sorted(newest)))
    return lines


def captured_bytes(path: Path) -> bytes:
    """Return the bytes of a capture: a binary file, or text in hex.

    Raises:
        OSError: it cannot be read.
        ValueError: it is too large.
    """
    data = path.read_bytes()
    if len(data) > MOST_CAPTURED:
        raise ValueError(f"{path} has more than {MOST_CAPTURED >> 20} MB")
    try:
        text = data.decode("ascii")
    except UnicodeDecodeError:
        return data
    plain = re.sub(r"\s|0[xX](?=[0-9a-fA-F]{2}\b)|,", "", text)
    return bytes.fromhex(plain) if re.fullmatch(r"(?:[0-9a-fA-F]{2})++", plain) else data
