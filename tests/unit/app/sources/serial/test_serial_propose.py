"""A profile out of captured bytes: what is proposed reads them as they were sent."""

import struct

import numpy as np
import pytest

from app.sources.loaded_battery import battery_from_files, load_battery
from app.sources.serial.checksums import checksum_of
from app.sources.serial.decoder import SerialDecoder
from app.sources.serial.framing import StreamReader
from app.sources.serial.propose import fitting, profile_text, propose
from tests.unit.app.sources.serial.test_serial_frames import DALY, JBD_BASIC, JBD_CELLS

N_FRAMES = 12


def volts_of(k: int, n: int) -> np.ndarray:
    random = np.random.default_rng(k)
    return np.round(3.62 + 0.01 * random.standard_normal(n) - 0.002 * k, 3)


def framed(kind: str, order: str, n_cells: int, *, header: bytes, tail: bytes) -> bytes:
    """A capture that begins within a frame."""
    found = checksum_of(kind)
    assert found is not None
    size, calc = found
    frames = []
    for k in range(N_FRAMES):
        values = (1e3 * volts_of(k, n_cells)).round().astype(int)
        body = header + bytes([k & 0xFF]) + struct.pack(f"{'<' if order == 'little' else '>'}{n_cells}H", *values)
        frames.append(body + calc(body).to_bytes(size, order) + tail)
    return b"".join(frames)[7:]


@pytest.mark.parametrize(
    ("kind", "order", "header", "tail"),
    [
        ("crc-16/modbus", "little", b"\x5a\xa5", b""),
        ("crc-16/xmodem", "big", b"\x02\x60", b"\x03"),
        ("sum8", "big", b"\xa5\x01", b""),
        ("sum16", "little", b"\xaa\x55\x01", b"\x0d\x0a"),
    ],
)
@pytest.mark.parametrize("n_cells", [7, 16])
def test_a_proposal_reads_the_capture_as_it_was_sent(kind, order, header, tail, n_cells):
    capture = framed(kind, order, n_cells, header=header, tail=tail)
    found = propose(capture)
    assert found is not None
    loaded = battery_from_files({"x.toml": profile_text(found, "x", 9600).encode()})
    assert loaded.battery.n_cells == n_cells
    reader, decoder = StreamReader(loaded.serial), SerialDecoder(loaded.battery, loaded.serial)
    values = decoder.decode(reader.feed(capture, 0))["voltage"]
    assert reader.frames == N_FRAMES - 1
    assert values.value[-n_cells:] == pytest.approx(volts_of(N_FRAMES - 1, n_cells))


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("kind", ["f32", "numbered"])
def test_cells_as_floats_and_cells_behind_their_number_are_proposed(kind, order):
    _, calc = checksum_of("crc-32")
    frames = []
    for k in range(N_FRAMES):
        volts = volts_of(k, 10)
        cells = struct.pack(f"{order}10f", *volts)
        if kind == "numbered":
            cells = b"".join(struct.pack(f"{order}BH", i + 1, round(1e3 * volt)) for i, volt in enumerate(volts))
        body = b"\xaa\x55" + bytes([k]) + cells
        frames.append(body + calc(body).to_bytes(4, "little"))
    capture = b"".join(frames)
    proposed = propose(capture)
    loaded = battery_from_files({"x.toml": profile_text(proposed, "x", 9600).encode()})
    reader, decoder = StreamReader(loaded.serial), SerialDecoder(loaded.battery, loaded.serial)
    values = decoder.decode(reader.feed(capture, 0))["voltage"]
    assert values.value[-10:] == pytest.approx(volts_of(N_FRAMES - 1, 10), abs=1e-6)


def test_lines_are_proposed_with_their_columns():
    lines = [",".join(["run", *map(str, (1e4 * volts_of(k, 12)).round().astype(int))]) for k in range(6)]
    found = propose("\r\n".join(lines).encode())
    assert (found.separator, found.columns, found.voltages) == (",", 13, (1, 12, 1e-4))


@pytest.mark.parametrize("kind", ["sum16-complement", "crc-16/modbus", None])
def test_lines_of_bytes_in_hex_are_proposed_with_their_checksum(kind):
    lines = []
    for k in range(6):
        text = f"20024600{k:02X}" + (1e3 * volts_of(k, 15)).round().astype(">u2").tobytes().hex().upper()
        if kind is not None:
            size, calc = checksum_of(kind)
            text += calc(text.encode()).to_bytes(size, "big").hex().upper()
        lines.append(f"~{text}\r")
    capture = "".join(lines).encode()
    proposed = propose(capture)
    assert (proposed.checksum and proposed.checksum.kind) == kind
    loaded = battery_from_files({"x.toml": profile_text(proposed, "x", 9600).encode()})
    assert loaded.battery.n_cells == 15
    reader, decoder = StreamReader(loaded.serial), SerialDecoder(loaded.battery, loaded.serial)
    values = decoder.decode(reader.feed(capture, 0))["voltage"]
    assert (reader.frames, reader.bad_frames) == (6, 0)
    assert values.value[-15:] == pytest.approx(volts_of(5, 15))


def test_a_known_protocol_is_named():
    bundled = {name: load_battery(name).serial for name in ("jbd", "daly", "vesc-bms", "thesis-arrays")}
    assert fitting((JBD_CELLS + JBD_BASIC) * 3, bundled) == "jbd"
    assert fitting(b"".join(DALY) * 3, bundled) == "daly"
    assert fitting(bytes(np.random.default_rng(1).integers(0, 256, 3000, np.uint8)), bundled) is None


def test_noise_proposes_no_cells():
    found = propose(bytes(np.random.default_rng(2).integers(0, 256, 20_000, np.uint8)))
    assert found is None or found.voltages is None
