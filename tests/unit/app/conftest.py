"""A made-up master: an image of plausible values, and frames of it; sessions made of arrays."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from app.sessions.writer import Recorder
from app.telemetry import SerialItem
from firmware_protocol.config_image import default_image
from firmware_protocol.framing import decode_chunk, encode_frame
from firmware_protocol.memory_map import FIELDS, MASTER_SIZE
from firmware_protocol.messages import Data, MessageType, Window

FAST = ((420, 20), (1884, 204), (2280, 116), (2982, 2))


@dataclass
class FakeMaster:
    """Fields are set by name in raw counts; `frame` gives the next telemetry frame as the link would."""

    image: bytearray = field(default_factory=lambda: bytearray(MASTER_SIZE))
    sequence: int = 0
    uptime_ms: int = 1000
    t_ns: int = 1_000_000_000

    def __post_init__(self) -> None:
        self.image[:420] = default_image()
        self.set("v", [37000 + i for i in range(96)])
        self.set("t", [25] * 96)
        self.set("i_fs", [1000])
        self.set("status.flags", [0b100000001])  # fit, load
        self.set("soc", [8000])
        self.set("v_tot", [35520])

    def set(self, name: str, values) -> None:
        FIELDS[name].pack_into(self.image, tuple(values))

    def windows(self, *ranges: tuple[int, int]) -> SerialItem:
        body = Data(tuple(Window(o, bytes(self.image[o : o + n])) for o, n in ranges)).to_body()
        return self.item(MessageType.DATA, body)

    def item(self, kind: int, body: bytes) -> SerialItem:
        raw = encode_frame(kind, self.sequence, self.uptime_ms, body)[1:-1]
        self.sequence = (self.sequence + 1) & 0xFF
        return SerialItem(self.t_ns, 1_700_000_000_000_000_000 + self.t_ns, decode_chunk(raw))

    def advance(self, ms: int = 100) -> None:
        self.uptime_ms += ms
        self.t_ns += ms * 1_000_000

    def frame(self, ms: int = 100) -> SerialItem:
        self.advance(ms)
        return self.windows(*FAST)

    def config(self) -> SerialItem:
        return self.windows((0, 420))


@pytest.fixture
def master() -> FakeMaster:
    return FakeMaster()


START_S = 1_790_000_000.0


class SessionMaker:
    """Records one session a call; times in seconds from its start."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __call__(
        self,
        time_s,
        current_a,
        voltage_v=3.7,
        temperature_degc=25,
        soc=None,
        *,
        markers=(),
        events=(),
        can=(),
        config=None,
        start_s=START_S,
        windows=FAST,
        fields=None,
        metadata=None,
        closed=True,
    ) -> Path:
        """Record arrays: (n,) current, and (n,), (n, 96) or scalar voltage, temperature and SOC.

        `fields` are (n, count) raw counts of other fields of the struct; `markers` are (at_s, kind, text), `events`
        keyword arguments with `at_s`, `can` (at_s, id, data).
        """
        n = len(time_s)
        volts, degrees = (_table(values, n) for values in (voltage_v, temperature_degc))
        wall_ns = round(start_s * 1e9)
        recorder = Recorder(
            self.folder, version="test", monotonic_ns=lambda: 0, wall_ns=lambda: wall_ns, free_bytes=lambda _: 1 << 40
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
            values = {
                "i_fs": [round(float(current_a[i]) * 100)],
                "v": counts,
                "t": heat,
                "v_tot": [round(counts.sum() / 100)],
                "v_min": [counts.min()],
                "v_min_id": [counts.argmin()],
                "v_max": [counts.max()],
                "t_max": [heat.max()],
                "t_max_id": [heat.argmax()],
                "t_avg": [round(heat.mean())],
            } | {name: table[i] for name, table in (fields or {}).items()}
            for name, row in values.items():
                FIELDS[name].pack_into(image, tuple(int(value) for value in row))
            body = Data(tuple(Window(o, bytes(image[o : o + length])) for o, length in windows)).to_body()
            raw = encode_frame(MessageType.DATA, i & 0xFF, round(at_s * 1000) & 0xFFFFFFFF, body)[1:-1]
            recorder.frame(at_ns, wall_ns + at_ns, 0, raw, True)
            if soc is not None:
                recorder.estimates(at_ns, round(at_s * 1000), _table(soc, n)[i], np.full(96, 0.01))
        for at_s, can_id, data in can:
            recorder.can_frame(round(at_s * 1e9), wall_ns + round(at_s * 1e9), can_id, data)
        for at_s, kind, text in markers:
            recorder.marker(round(at_s * 1e9), wall_ns + round(at_s * 1e9), text, kind=kind)
        for event in events:
            at_ns = round(event["at_s"] * 1e9)
            named = {key: value for key, value in event.items() if key not in ("at_s", "severity", "code", "text")}
            recorder.event(at_ns, wall_ns + at_ns, event["severity"], event["code"], event["text"], **named)
        if closed:
            recorder.close()
        else:
            recorder.flush()
        return info.path


def _table(values, n):
    values = np.asarray(values, dtype=float)
    return np.broadcast_to(values[:, None] if values.ndim == 1 else values, (n, 96))


@pytest.fixture
def make_session(tmp_path: Path) -> SessionMaker:
    return SessionMaker(tmp_path / "sessions")
