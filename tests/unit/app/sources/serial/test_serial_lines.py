"""Lines of text as people print them: labels, units, one cell a line, JSON, other prints between."""

import numpy as np
import pytest

from app.sources.loaded_battery import battery_from_files
from app.sources.serial.check import serial_issues
from app.sources.serial.decoder import SerialDecoder
from app.sources.serial.encoder import SerialEncoder
from app.sources.serial.framing import StreamReader
from tests.unit.app.sources.serial.test_serial_frames import decoded

HEAD = '[battery]\nname = "x"\nsegments = [4]\n[battery.temperatures]\nsensors = 0\n[serial]\n'
LABELS = """
[[serial.line]]
separator = " "
begin = "DATA "
fields = [
  { signal = "cells.voltage", columns = [0, 3], begin = "=", end = "V" },
  { signal = "current", column = 4, begin = "=", end = "A" },
]
"""
A_CELL_A_LINE = """
[[serial.line]]
begin = "cell "
separator = ": "
fields = [{ signal = "cells.voltage", column = 1, end = " V", index = { column = 0, base = 1 } }]
[[serial.line]]
begin = "amps "
fields = [{ signal = "current", column = 0 }]
"""
JSON = """
[[serial.line]]
pattern = '"cells":\\[(?P<cells>[0-9.,]+)\\].*"current":(?P<amps>[-0-9.]+)'
fields = [{ signal = "cells.voltage", group = "cells" }, { signal = "current", group = "amps" }]
"""
NMEA = """
[[serial.line]]
begin = "$BMS,"
end = "\\r\\n"
checksum = { kind = "xor8", from = 1, to = -3, at = -2 }
fields = [
  { signal = "current", column = 0 },
  { signal = "cells.voltage", columns = [1, 4], scale = 0.001 },
]
"""
VOLTS, AMPS = [3.701, 3.702, 3.7, 3.699], -12.5
CASES = {
    "labels": (LABELS, "boot ok\r\nDATA C1=3.701V C2=3.702V C3=3.700V C4=3.699V I=-12.5A\r\nDATA C1=3.701V"),
    "a cell a line": (
        A_CELL_A_LINE,
        "ready\n" + "".join(f"cell {k + 1}: {volt} V\n" for k, volt in enumerate(VOLTS)) + f"amps {AMPS}\n",
    ),
    "JSON": (JSON, 'log: started\n{"t":1,"cells":[3.701,3.702,3.7,3.699],"soc":50,"current":-12.5}\n'),
    "NMEA": (NMEA, "$BMS,-12.5,3701,3702,3700,3699*{}\r\n"),
}


def stream_of(name):
    text = CASES[name][1]
    if "{}" not in text:
        return text.encode()
    sum_ = 0
    for byte in text[1 : text.index("*")].encode():
        sum_ ^= byte
    return text.format(f"{sum_:02X}").encode()


@pytest.mark.parametrize("name", CASES)
def test_lines_are_read_as_they_are_printed(name):
    loaded = battery_from_files({"x.toml": (HEAD + CASES[name][0]).encode()})
    stream = stream_of(name)
    values, reader = decoded(loaded, [*(stream,) * 3] if name != "NMEA" else [stream])  # a first one waits
    newest = dict(zip(values["voltage"].index.tolist(), values["voltage"].value.tolist(), strict=True))
    assert newest == {cell: pytest.approx(volt) for cell, volt in enumerate(VOLTS)}
    assert values["current"].value[-1] == pytest.approx(AMPS)
    assert reader.bad_frames == 0
    if name != "NMEA":
        issues = serial_issues(loaded.battery, loaded.serial, "x", None)
        assert {issue.what.code for issue in issues} == {"check-no-checksum"}


def test_a_line_with_a_wrong_checksum_is_bad_and_gives_no_value():
    loaded = battery_from_files({"x.toml": (HEAD + NMEA).encode()})
    values, reader = decoded(loaded, [stream_of("NMEA").replace(b"3702", b"3703")])
    assert (values, reader.bad_frames, reader.frames) == ({}, 1, 0)


def test_a_word_for_a_cell_that_is_not_measured_is_missing():
    loaded = battery_from_files({"x.toml": (HEAD + LABELS).encode()})
    line = b"DATA C1=3.701V C2=nan C3=3.700V C4=3.699V I=-12.5A\r\n"
    values, _ = decoded(loaded, [line] * 3)
    assert set(values["voltage"].index.tolist()) == {0, 2, 3}


def test_a_simulated_battery_prints_a_line_a_cell():
    loaded = battery_from_files(
        {"x.toml": (HEAD + A_CELL_A_LINE.replace('end = " V"', 'end = " V", scale = 0.001')).encode()}
    )
    encoder = SerialEncoder(loaded.battery, loaded.serial)
    encoder.begin(0.0)
    sent = encoder.bytes_due(1.0, {"voltage": np.array(VOLTS)})
    assert sent.startswith(b"cell 1: 3701 V\r\ncell 2: 3702 V\r\n")
    reader, decoder = StreamReader(loaded.serial), SerialDecoder(loaded.battery, loaded.serial)
    assert decoder.decode(reader.feed(sent, 0))["voltage"].value.tolist() == pytest.approx(VOLTS)
