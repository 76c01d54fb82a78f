"""What the simulated battery sends is read back as what it measured, for every bundled serial profile."""

import numpy as np
import pytest

from app.battery.library import bundled_profiles
from app.sources.loaded_battery import battery_from_files, load_battery
from app.sources.serial.decoder import SerialDecoder
from app.sources.serial.encoder import SerialEncoder
from app.sources.serial.framing import StreamReader
from tests.unit.app.sources.serial.test_public_protocols import CASES

PARTS = ("ivt-s",)
SERIAL = [name for name in bundled_profiles() if name not in PARTS and load_battery(name).serial is not None]


@pytest.mark.parametrize("name", [*SERIAL, "Pylontech", "Chargery", "JK"])
def test_what_is_sent_is_read_as_what_was_measured(name):
    loaded = load_battery(name) if name in SERIAL else battery_from_files({"x.toml": CASES[name][0].encode()})
    mapping, battery = loaded.serial, loaded.battery
    encoder, reader, decoder = (
        SerialEncoder(battery, mapping),
        StreamReader(mapping),
        SerialDecoder(battery, mapping),
    )
    measured = {
        "voltage": 3.6 + 0.001 * np.arange(battery.n_cells),
        "temperature": 20.0 + np.arange(battery.n_sensors) % 9,
        "balancing": (np.arange(battery.n_cells) % 3 == 0).astype(float),
        "current": np.array([-12.5]),
        "pack_voltage": np.array([55.5]),
        "soc": np.array([0.62]),
    }
    encoder.begin(0.0)
    encoder.receive(mapping.port.start + b"".join(part.poll for part in mapping.parts), 0.0)
    frames = []
    for k in range(3):  # a first sample without a checksum waits for a second
        frames += reader.feed(encoder.bytes_due(10.0 * k, measured), round(1e10 * k))
        encoder.receive(b"".join(part.poll for part in mapping.parts), 10.0 * k)
    frames += reader.idle(round(1e12))
    values = decoder.decode(frames)
    assert set(values) == set(mapping.kinds)
    for kind, of_kind in values.items():
        newest = dict(zip(of_kind.index.tolist(), of_kind.value.tolist(), strict=True))
        step = max(abs(each.scale) for each in mapping.fields if each.kind == kind)
        expected = measured[kind]
        assert [newest[k] for k in range(len(expected))] == pytest.approx(expected.tolist(), abs=step)


def test_a_stream_begins_and_ends_where_it_is_asked():
    loaded = load_battery("thesis-arrays")
    encoder = SerialEncoder(loaded.battery, loaded.serial)
    encoder.begin(0.0)
    assert encoder.bytes_due(1.0, {}) == b""
    encoder.receive(b"x", 1.0)
    assert len(encoder.bytes_due(1.0, {})) == 292
    encoder.receive(b"y", 2.0)
    assert encoder.bytes_due(9.0, {}) == b""
