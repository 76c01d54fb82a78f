"""What `battery check` reads out of a captured file, whatever wrote it."""

import pytest

from app.sources.loaded_battery import load_battery
from app.sources.serial.check import captured_bytes, serial_issues, shown_values
from tests.thesis_streams import arrays, hex_line, volts
from tests.unit.app.sources.serial.test_serial_frames import JBD_BASIC, JBD_CELLS, READ

STREAM = JBD_CELLS + JBD_BASIC


@pytest.mark.parametrize(
    "text",
    [
        STREAM.hex(),
        STREAM.hex(" ").upper(),
        STREAM.hex(":"),
        STREAM.hex(".").upper() + ".\n",
        STREAM.hex("-"),
        ", ".join(f"0x{byte:02X}" for byte in STREAM),
        "\r\n".join(STREAM[k : k + 16].hex(" ") for k in range(0, len(STREAM), 16)),
        STREAM,
    ],
)
def test_a_dump_in_hex_is_the_bytes_that_it_stands_for(tmp_path, text):
    path = tmp_path / "capture"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    loaded = load_battery("jbd")
    capture = captured_bytes(path, loaded.battery, loaded.serial)
    assert capture == captured_bytes(path) == STREAM
    assert serial_issues(loaded.battery, loaded.serial, "x", capture) == []
    shown = next(line for line in shown_values(loaded.battery, loaded.serial, capture) if line.startswith("voltage"))
    assert [float(volt) for volt in shown.split()[1:]] == pytest.approx(READ["jbd"]["voltage"])


def test_lines_of_hex_numbers_are_text_and_no_dump(tmp_path):
    path = tmp_path / "lines.txt"
    path.write_bytes(b"".join(hex_line(k) for k in range(5)))
    loaded = load_battery("thesis-hex")
    capture = captured_bytes(path, loaded.battery, loaded.serial)
    assert capture == captured_bytes(path) == path.read_bytes()
    assert shown_values(loaded.battery, loaded.serial, capture)[0].startswith("5 frames ")


@pytest.mark.parametrize("begin", [0, 100])
def test_frames_that_silence_parts_follow_each_other_in_a_capture(begin):
    loaded = load_battery("thesis-arrays")
    capture = b"".join(arrays(k) for k in range(4))[begin:]
    shown = shown_values(loaded.battery, loaded.serial, capture)
    assert shown[0].startswith(f"{3 if begin else 4} frames")
    newest = next(line for line in shown if line.startswith("voltage")).split()[1:]
    assert [float(volt) for volt in newest] == pytest.approx(volts(3).tolist(), abs=1e-3)


def test_a_sensor_that_is_not_connected_measures_nothing_and_is_counted():
    loaded = load_battery("jbd")
    data = bytearray(JBD_BASIC)
    data[29:31] = (2731 - 400).to_bytes(2, "big")  # -40 degC
    data[-3:-1] = (-sum(data[2:-3]) & 0xFFFF).to_bytes(2, "big")
    issues = serial_issues(loaded.battery, loaded.serial, "x", JBD_CELLS + bytes(data))
    assert [(issue.what.code, issue.what.args["numbers"], issue.what.args["values"]) for issue in issues] == [
        ("check-absent", "2", 1)
    ]
    shown = shown_values(loaded.battery, loaded.serial, JBD_CELLS + bytes(data))
    assert "temperature: 20.3 nan" in shown
