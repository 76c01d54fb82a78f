"""Sessions made of arrays: what is said about the car becomes frames in a file, for tests and measurements."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from app.sessions.recording.recorder import Recorder
from app.sources.loaded_battery import LoadedBattery
from app.telemetry import Event
from app.words import Message
from firmware_protocol.config_image import default_image
from firmware_protocol.framing import encode_frame
from firmware_protocol.memory_map import FIELDS, MASTER_SIZE
from firmware_protocol.messages import Data, MessageType, Window
from tests.fake_clock import FunctionClock

START_S = 1_790_000_000.0
TEMPERATURES = 2280  # the offset of their window
FAST = ((420, 20), (1884, 204), (2280, 116), (2982, 2))


class SessionMaker:
    """Records one session a call; times in seconds from its start."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __call__(
        self,
        time_s: ArrayLike,
        current_a: ArrayLike,
        voltage_v: ArrayLike = 3.7,
        temperature_degc: ArrayLike = 25,
        soc: ArrayLike | None = None,
        *,
        markers: Sequence[tuple[float, str, str]] = (),
        events: Sequence[Mapping[str, Any]] = (),
        can: Sequence[tuple[float, int, bytes]] = (),
        config: bytes | None = None,
        start_s: float = START_S,
        windows: Sequence[tuple[int, int]] = FAST,
        fields: Mapping[str, NDArray[np.int64]] | None = None,
        metadata: Mapping[str, object] | None = None,
        cell_file: str | None = None,
        closed: bool = True,
        flush_every: int = 0,
        temperature_every: int = 1,
        battery: LoadedBattery | None = None,
    ) -> Path:
        """Record arrays: (n,) current, and (n,), (n, 96) or scalar voltage, temperature and SOC.

        `fields` are (n, count) raw counts of other fields of the struct; `markers` are (at_s, kind, text), `events`
        keyword arguments with `at_s`, `can` (at_s, id, data). After `flush_every` frames all are brought to the disk;
        one frame in `temperature_every` tells temperatures.
        """
        time_s, current_a = np.asarray(time_s, dtype=np.float64), np.asarray(current_a, dtype=np.float64)
        n = len(time_s)
        volts, degrees = (_table(values, n) for values in (voltage_v, temperature_degc))
        wall_ns = round(start_s * 1e9)
        recorder = Recorder(
            self.folder,
            FunctionClock(lambda: 0, lambda: wall_ns),
            version="test",
            free_bytes=lambda _: 1 << 40,
            cell_file=cell_file,
            battery=battery,
        )
        info = recorder.start("made", metadata or {})
        recorder.config(0, wall_ns, config or default_image(), "in force at the start")
        image = bytearray(MASTER_SIZE)
        image[:420] = config or default_image()
        FIELDS["status.flags"].pack_into(image, (0b100000001,))
        for i, at_s in enumerate(time_s):
            at_ns = round(at_s * 1e9)
            counts = np.where(np.isnan(volts[i]), 0, volts[i] * 1e4).round().astype(int)
            heat = np.where(np.isnan(degrees[i]), -128, degrees[i]).round().astype(int)
            values: dict[str, Any] = {
                "i_fs": [round(float(current_a[i]) * 100)],
                "v": counts,
                "t": heat,
                "v_tot": [round(counts.sum() / 100)],
                "v_avg": [round(counts[counts > 0].mean()) if counts.any() else 0],
                "v_min": [counts.min()],
                "v_min_id": [counts.argmin()],
                "v_max": [counts.max()],
                "t_max": [heat.max()],
                "t_max_id": [heat.argmax()],
                "t_avg": [round(heat.mean())],
            } | {name: table[i] for name, table in (fields or {}).items()}
            for name, row in values.items():
                FIELDS[name].pack_into(image, tuple(int(value) for value in row))
            sent = [each for each in windows if each[0] != TEMPERATURES or i % temperature_every == 0]
            body = Data(tuple(Window(o, bytes(image[o : o + length])) for o, length in sent)).to_body()
            raw = encode_frame(MessageType.DATA, i & 0xFF, round(at_s * 1000) & 0xFFFFFFFF, body)[1:-1]
            recorder.frame(at_ns, wall_ns + at_ns, 0, raw, True)
            if soc is not None:
                recorder.estimates(at_ns, round(at_s * 1000), _table(soc, n)[i], np.full(96, 0.01))
            if flush_every and i % flush_every == 0:
                recorder.flush()
        for at_s, can_id, data in can:
            recorder.can_frame(round(at_s * 1e9), wall_ns + round(at_s * 1e9), can_id, data)
        for at_s, kind, text in markers:
            recorder.marker(round(at_s * 1e9), wall_ns + round(at_s * 1e9), text, kind=kind)
        for event in events:
            at_ns = round(event["at_s"] * 1e9)
            about = {key: value for key, value in event.items() if key not in ("at_s", "severity", "code", "text")}
            told = Message("verbatim", text=event["text"])
            recorder.event(at_ns, Event(wall_ns + at_ns, event["severity"], event["code"], told, **about))
        if closed:
            recorder.close()
        else:
            recorder.flush()
        return info.path


def _table(values: ArrayLike, n: int) -> NDArray[np.float64]:
    table = np.asarray(values, dtype=np.float64)
    return np.broadcast_to(table[:, None] if table.ndim == 1 else table, (n, 96))
