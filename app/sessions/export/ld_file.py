"""MoTeC i2's .ld: every channel at one rate, its header in a chain; markers of the kind "lap" as beacons in an .ldx.

The layout is not published; this one is what readers and writers of such files agree on. Values are f32. The format
knows no missing values: until the next sample the last one is held, over a gap it is NaN.
"""

import struct
from collections.abc import Iterable, Iterator
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.sax.saxutils import quoteattr
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
from numpy.typing import NDArray

from app.errors import ConfigError
from app.estimation.arrays import FloatArray
from app.sessions.export.table import AGE, FILLED, SIMULATED, SignalTable
from app.sessions.reading.series import SeriesSamples, find_gaps
from app.sessions.storage.chunks import Track
from app.sessions.storage.signals import StoredSignal
from app.words import Message

_HEADER = struct.Struct("<I4xII20xI24x3HI8sHHI4x16s16x16s16x64s64s64x64s64x1024xI66x64s126x64s64s")
_EVENT = struct.Struct("<64s64s1024sH")
_VENUE = struct.Struct("<64s1034xH")
_VEHICLE = struct.Struct("<64s128xI32s32s")
_CHANNEL = struct.Struct("<4I4H4h32s8s12s40x")
_VEHICLE_AT, _VENUE_AT, _EVENT_AT, _CHANNELS_AT = 1762, 5078, 8180, 11336  # where i2's own files have them
_MARK = 0x40
_SAME_S = 1.0  # the first sample of a range comes a little after the lap that it is of began
_PRO_LOGGING = 0xC81A4
_DEVICE = (1, 0x4240, 0xF, 0x1F44, b"ADL", 420, 0xADB0)
_FLOAT, _FLOAT_SIZE = 7, 4
_FIRST_CHANNEL_ID = 0x2EE1
MAX_RATE_HZ = 1000
_CONSTANT = (FILLED, SIMULATED)


def write_ld(table: SignalTable, path: Path) -> None:
    """Write the file; every signal is read once."""
    signals = _channels(table)
    samples = _samples(table)
    table.on_progress(1, 1 + len(signals))
    times, rate_hz = _extent(table, samples.values())
    name_of = dict(zip(table.signals, table.names, strict=True))
    n_samples = 0 if times is None else int((times[1] - times[0]) * rate_hz) + 1
    start_s = table.info.started_wall_ns / 1e9 if times is None else times[0]
    data_at = _CHANNELS_AT + _CHANNEL.size * len(signals)
    with path.open("wb") as file:
        file.write(_head(table, start_s, data_at))
        for i, signal in enumerate(signals):
            file.write(_channel(i, len(signals), name_of[signal], signal.unit, data_at, n_samples, rate_hz))
        grid_s = start_s + np.arange(n_samples) / rate_hz
        for i, values in enumerate(_resampled(table, samples, grid_s), 2):
            file.write(values.astype("<f4").tobytes())
            table.on_progress(i, 1 + len(signals))


def _channels(table: SignalTable) -> list[StoredSignal]:
    """Without AGE: a value that is held has no age of its own."""
    return [signal for signal in table.signals if signal is not AGE]


def _samples(table: SignalTable) -> dict[StoredSignal, SeriesSamples]:
    """The samples of each signal of the session, packed as they are stored until they are asked for."""
    recorded = [signal for signal in _channels(table) if signal not in _CONSTANT]
    return dict(zip(recorded, table.session.samples(recorded, table.t_from_s, table.t_to_s), strict=True))


def _extent(table: SignalTable, samples: Iterable[SeriesSamples]) -> tuple[tuple[float, float] | None, int]:
    """First and last sample time, and the rate of the quickest signal in whole hertz, rounded up."""
    first, last, rate_hz = [], [], 1
    for times_us in {id(sample.track): sample.track.times_us for sample in samples}.values():
        if len(times_us):
            first.append(table.session.unix_s(int(times_us[0]) * 1000))
            last.append(table.session.unix_s(int(times_us[-1]) * 1000))
        if len(times_us) > 1:
            period_s = float(np.median(np.diff(times_us))) / 1e6
            rate_hz = max(rate_hz, min(MAX_RATE_HZ, int(np.ceil(1 / max(period_s, 1e-3) - 0.05))))
    return ((min(first), max(last)) if first else None), rate_hz


def _resampled(
    table: SignalTable, samples: dict[StoredSignal, SeriesSamples], grid_s: FloatArray
) -> Iterator[FloatArray]:
    """Each channel's (n,) last value before each grid time, NaN before the first one and in gaps; `samples` empties."""
    track: Track | None = None
    for signal in _channels(table):
        if signal in _CONSTANT:
            yield table.constant(signal, grid_s)
            continue
        series = samples.pop(signal)
        if series.track is not track:
            track = series.track
            index, is_known = _last_before(table, track.times_us, grid_s)
        values = np.full(len(grid_s), np.nan)
        values[is_known] = signal.physical(series.counts)[index[is_known]]
        yield values


def _last_before(
    table: SignalTable, times_us: NDArray[np.int64], grid_s: FloatArray
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Of each grid time, the last sample before it, and whether there is one and it is not before a gap."""
    if not len(times_us):
        return np.full(len(grid_s), -1), np.zeros(len(grid_s), bool)
    times_s = table.session.unix_s(int(times_us[0]) * 1000) + (times_us - times_us[0]) / 1e6
    index: NDArray[np.intp] = np.searchsorted(times_s, grid_s + 1e-6, side="right") - 1
    usual_s = float(np.median(np.diff(times_s))) if len(times_s) > 1 else 0.0
    before_gap = np.zeros(len(times_s), bool)
    before_gap[find_gaps(times_s)] = True
    return index, (index >= 0) & ~(before_gap[index] & (grid_s > times_s[index] + usual_s))


def _text(text: str, length: int) -> bytes:
    return text.encode("ascii", "replace")[: length - 1]


def _head(table: SignalTable, start_s: float, data_at: int) -> bytes:
    """Everything before the channels' headers."""
    info, when = table.info, datetime.fromtimestamp(start_s, UTC)
    driver, vehicle = (str(info.metadata.get(key, "")) for key in ("driver", "vehicle"))
    venue, event = (str(info.metadata.get(key, "")) for key in ("venue", "event"))
    comment = f"{'SIMULATED CAR, ' if table.is_simulated else ''}voltwall {info.voltwall}, session {info.id}"
    serials = (*_DEVICE, len(_channels(table)))
    head = bytearray(_CHANNELS_AT)
    _HEADER.pack_into(
        head, 0, _MARK, _CHANNELS_AT, data_at, _EVENT_AT, *serials,
        when.strftime("%d/%m/%Y").encode(), when.strftime("%H:%M:%S").encode(),
        _text(driver, 64), _text(vehicle, 64), _text(venue, 64), _PRO_LOGGING,
        _text(comment, 64), _text(event or info.name, 64), _text(info.name, 64),
    )  # fmt: skip
    _EVENT.pack_into(
        head, _EVENT_AT, _text(event or info.name, 64), _text(info.name, 64), _text(comment, 1024), _VENUE_AT
    )
    _VENUE.pack_into(head, _VENUE_AT, _text(venue, 64), _VEHICLE_AT)
    _VEHICLE.pack_into(head, _VEHICLE_AT, _text(vehicle, 64), 0, b"", b"")
    return bytes(head)


def _channel(i: int, n: int, name: str, unit: str, data_at: int, n_samples: int, rate_hz: int) -> bytes:
    here = _CHANNELS_AT + i * _CHANNEL.size
    return _CHANNEL.pack(
        here - _CHANNEL.size if i else 0,
        here + _CHANNEL.size if i + 1 < n else 0,
        data_at + i * n_samples * _FLOAT_SIZE,
        n_samples,
        (_FIRST_CHANNEL_ID + i) & 0xFFFF,
        _FLOAT,
        _FLOAT_SIZE,
        rate_hz,
        0,
        1,
        1,
        0,  # value = raw / scale * 10 ** -decimals * multiplier + shift, here the raw f32
        _text(name, 32),
        b"",
        _text("C" if unit == "degC" else unit, 12),
    )


def write_motec(table: SignalTable, path: Path) -> None:
    """Write a zip with the .ld and, where the range has laps, the .ldx, both named as the session."""
    with TemporaryDirectory() as folder, ZipFile(path, "w", ZIP_DEFLATED) as archive:
        data, laps = (Path(folder, table.info.id + suffix) for suffix in (".ld", ".ldx"))
        write_ld(table, data)
        archive.write(data, data.name)
        with suppress(ConfigError):  # no lap in this range
            write_ldx(table, laps)
            archive.write(laps, laps.name)


def write_ldx(table: SignalTable, path: Path) -> None:
    """Write where laps begin and end as the .ldx file that i2 opens with a .ld of the same name.

    Raises:
        ConfigError: there is no lap in the table's range.
    """
    times, _ = _extent(table, _samples(table).values())
    start_s, end_s = times if times is not None else (0.0, -1.0)
    beacons = [time_s - start_s for time_s in _beacons(table) if start_s < time_s <= end_s]
    if not beacons:
        raise ConfigError("format", "ldx", Message("with-laps"))
    lines = [
        f'<Marker Version="100" ClassName="BCN" Name={quoteattr(f"Lap.{i + 1}")} Flags="77" Time="{at_s * 1e6:.6e}"/>'
        for i, at_s in enumerate(beacons)
    ]
    # what lies before the first time that laps meet and after the last is no whole lap
    begins_a_lap = any(abs(time_s - start_s) <= _SAME_S for time_s in _beacons(table))
    laps = np.diff([0.0, *beacons] if begins_a_lap else beacons)
    fastest = ""
    if laps.size:
        minutes, seconds = divmod(float(laps.min()), 60)
        fastest = (
            f'<String Id="Fastest Time" Value="{int(minutes)}:{seconds:06.3f}"/>'
            f'<String Id="Fastest Lap" Value="{int(laps.argmin()) + (1 if begins_a_lap else 2)}"/>'
        )
    car = '<String Id="Vehicle Comment" Value="simulated car"/>' if table.is_simulated else ""
    path.write_text(
        '<?xml version="1.0"?>\n<LDXFile Locale="C" DefaultLocale="C" Version="1.6"><Layers><Layer><MarkerBlock>'
        f'<MarkerGroup Name="Beacons" Index="3">{"".join(lines)}</MarkerGroup></MarkerBlock><RangeBlock/></Layer>'
        f'<Details><String Id="Total Laps" Value="{len(beacons) + 1}"/>'
        f"{fastest}{car}</Details></Layers></LDXFile>\n",
        encoding="utf-8",
    )


def _beacons(table: SignalTable) -> list[float]:
    """Unix times at which laps meet; markers of the kind "lap" where the table knows no laps."""
    if table.lap_times_s is not None:
        return sorted(set(table.lap_times_s))
    return [table.session.unix_s(m.t_mono_ns) for m in table.session.markers() if m.kind == "lap"]
