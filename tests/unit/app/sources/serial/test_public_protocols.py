"""Batteries that are not bundled: profiles written from public descriptions, judged by frames that others print.

The frames and what they mean are those of esphome-ant-bms, -basen-bms, -jk-bms and -seplos-bms (documents and tests),
of a reader of the Pylontech US2000, of Chargery's protocol manual as venus-chargerybms prints it, and, for the VESC
BMS, of which no whole frame is published, the payload that a decoder's test describes byte by byte.
"""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.sources.loaded_battery import battery_from_files
from app.sources.serial.check import serial_issues
from app.sources.serial.checksums import checksum_of
from tests.unit.app.sources.serial.test_serial_frames import decoded

ANT = """
[battery]
name = "ANT, 16 cells"
segments = [16]
[battery.temperatures]
sensors = 2
[serial]
baud = 19200
[[serial.frame]]
header = "7E A1 11"
length_at = { offset = 5, size = 1, adds = 10 }
end = "AA 55"
checksum = { kind = "crc-16/modbus", from = 1, to = -4, at = -4 }
poll = "7E A1 01 00 00 BE 18 55 AA 55"
fields = [
  { signal = "cells.voltage", type = "u16", at = 34, count = 16, scale = 0.001 },
  { signal = "cells.temperature", type = "i16", at = 66, count = 2 },
  { signal = "pack.voltage", type = "u16", at = 74, scale = 0.01 },
  { signal = "current", type = "i16", at = 76, scale = 0.1 },
  { signal = "soc", type = "u16", at = 78, scale = 0.01 },
]
"""
ANT_FRAME = bytes.fromhex(
    "7EA11100008E05010210000000000000000080008001000000000000000000000000E40CE40CE50CE50CE80CE70CE70CE60CE80CE70CE70CE7"
    "0CE70CE70CE60CE90C0100020002000700A41403005B0064000101000000"
    "76B010D5670E0FBA324A000F00000010582E0200000000E90C1000E40C01000500E60C000080007A000F02F2FAB98C3B00BBD85800DA2D4300"
    "E8B649000543AA55"
)
BASEN = """
[battery]
name = "Basen, 8 cells"
segments = [8]
[battery.temperatures]
sensors = 4
[serial]
baud = 9600
[[serial.frame]]
header = "3A 16 24"
length_at = { offset = 3, size = 1, adds = 8 }
end = "0D 0A"
checksum = { kind = "sum16", from = 1, to = -4, at = -4 }
poll = "3A 16 24 01 00 3B 00 0D 0A"
fields = [{ signal = "cells.voltage", type = "u16", at = 4, count = 8, scale = 0.001 }]
[[serial.frame]]
header = "3B 16 2A"
length_at = { offset = 3, size = 1, adds = 8 }
end = "0D 0A"
checksum = { kind = "sum16", from = 1, to = -4, at = -4 }
poll = "3B 16 2A 01 00 41 00 0D 0A"
fields = [
  { signal = "current", type = "i32", at = 4, scale = 0.001 },
  { signal = "pack.voltage", type = "u32", at = 8, scale = 0.001 },
  { signal = "cells.temperature", type = "i8", at = 12, count = 4 },
  { signal = "soc", type = "u8", at = 24, scale = 0.01 },
]
"""
BASEN_FRAMES = bytes.fromhex(
    "3a162418960c970c980c960c960c980c980c970c00000000000000006a050d0a"
    "3B162A1800000000CE61000012141919632300008080000008020000"
    "6F030D0A"
)
JK = """
[battery]
name = "JK, 14 cells"
segments = [14]
[battery.temperatures]
sensors = 3
[serial]
baud = 115200
byte_order = "big"
[[serial.frame]]
header = "4E 57"
length_at = { offset = 2, size = 2, adds = 2 }
checksum = { kind = "sum16", from = 0, to = -4, at = -2 }
poll = "4E 57 00 13 00 00 00 00 06 03 00 00 00 00 00 00 68 00 00 01 29"
fields = [
  { signal = "cells.voltage", type = "u16", at = 14, count = 14, stride = 3, scale = 0.001 },
  { signal = "cells.temperature", type = "u16", at = 56, count = 3, stride = 3, valid_range = [0, 100] },
  { signal = "pack.voltage", type = "u16", at = 65, scale = 0.01 },
  { signal = "current", type = "sm16", at = 68, scale = 0.01 },
  { signal = "soc", type = "u8", at = 71, scale = 0.01 },
]
"""
JK_FRAME = bytes.fromhex(
    "4E57011B00000000060001792A010EED020EFA030EF7040EEC050EF8060EFA070EF1080EF8090EE30A0EFA0B0EF10C0EFB0D0EFB0E0EF2"
    "80001D81001E82001C8314EF8480D0850F86028700048900000000"
    "8A000E8B00008C00078E16268F10AE900FD2910FA0920005930BEA940C1C9500059601"
    "2C9700079800039900059A00059B0CE49C00089D019E005A9F0046A00064A10064A20014A30046A40046A5FFECA6FFF6A7FFECA8FFF6A90E"
    "AA0000000EAB01AC01AD0411AE01AF01B0000AB114B231323334353600000000B300B4496E707574205573B532313031B60000E200"
    "B7482E585F5F53362E312E33535F5F".replace("B7482E58", "B748362E58")
    + "B800B900000000BA425433303732303230313230303030323030353231303031C00100000000680000"
    + "54D1"
)
ASCII_HEX = """
[battery]
name = "{name}"
segments = [{cells}]
[battery.temperatures]
sensors = {sensors}
[serial]
baud = 9600
byte_order = "big"
[[serial.line]]
begin = "~200{address}4600"
end = "\\r"
hex = true
checksum = {{ kind = "sum16-complement", from = 1, to = -4, at = -4 }}
poll = "{poll}\\r"
fields = [
  {{ signal = "cells.voltage", type = "u16", at = 5, count = {cells}, scale = 0.001 }},
  {{ signal = "cells.temperature", type = "u16", at = {t_at}, count = {sensors}, scale = 0.1, offset = -273.1 }},
  {{ signal = "current", type = "i16", at = {i_at}, scale = {i_scale}, positive = "charge" }},
  {{ signal = "pack.voltage", type = "u16", at = {v_at}, scale = {v_scale} }},
]
"""
PYLONTECH = ASCII_HEX.format(
    name="Pylontech US2000", cells=15, sensors=5, address=2, poll="~20024642E00202FD33",
    t_at=36, i_at=46, i_scale=0.1, v_at=48, v_scale=0.001,
)  # fmt: skip
PYLONTECH_LINE = (
    b"~20024600C06E10020F0C9A0C980C990C980C9A0C9A0C990C9B0C9C0C9A0C9B0C9B0C9B0C9B0C99050B740B550B570B530B63"
    b"0000BD06190F02C3500084E545\r"
)
SEPLOS = ASCII_HEX.format(
    name="Seplos V2", cells=16, sensors=6, address=0, poll="~20004642E00200FD37",
    t_at=38, i_at=50, i_scale=0.01, v_at=52, v_scale=0.01,
)  # fmt: skip
SEPLOS_LINE = (
    b"~2000460010960001100CD70CE90CF40CD60CEF0CE50CE10CDC0CE90CF00CE80CEF0CEA0CDA0CDE0CD8"
    b"060BA60BA00B970BA60BA50BA2FD5C14A0344E0A426803134650004603E8149F0000000000000000DC6C\r"
)
CHARGERY = """
[battery]
name = "Chargery, 16 cells"
segments = [16]
[battery.temperatures]
sensors = 2
[serial]
byte_order = "big"
[[serial.frame]]
header = "24 24 56"
length_at = { offset = 3 }
checksum = { kind = "sum8" }
fields = [{ signal = "cells.voltage", type = "u16", at = 4, count = 16, scale = 0.001 }]
[[serial.frame]]
header = "24 24 57"
length_at = { offset = 3 }
checksum = { kind = "sum8" }
fields = [
  { signal = "current", type = "u16", at = 7, scale = 0.1, charging = { at = 6 } },
  { signal = "cells.temperature", type = "u16", at = 9, count = 2, scale = 0.1 },
  { signal = "soc", type = "u8", at = 13, scale = 0.01 },
]
"""
CHARGERY_FRAMES = bytes.fromhex(
    "2424562D0CFD0D040D040D020D030D040D060D010D080D020D050CFE0D060CFB0D0F0CFC76FED50263140E0095"
    "2424570F0E240100E4008100845B25"
)
VESC = """
[battery]
name = "VESC BMS, 3 cells"
segments = [3]
[battery.temperatures]
sensors = 1
[serial]
byte_order = "big"
[[serial.frame]]
header = "02 ?? 60"
length_at = { offset = 1, adds = 5 }
end = "03"
checksum = { kind = "crc-16/xmodem", from = 2, to = -3, at = -3 }
fields = [
  { signal = "pack.voltage", type = "i32", at = 3, scale = 0.000001 },
  { signal = "current", type = "i32", at = 11, scale = 0.000001 },
  { signal = "cells.voltage", type = "i16", at = 28, count = 3, scale = 0.001 },
  { signal = "cells.balancing", type = "u8", at = 34, count = 3 },
  { signal = "cells.temperature", type = "i16", at = 38, scale = 0.01 },
  { signal = "soc", type = "i16", at = 48, scale = 0.001 },
]
"""


def vesc_frame() -> bytes:
    payload = bytearray(51)
    struct.pack_into(">BI4xI", payload, 0, 0x60, 60_000_000, 5_000_000)
    struct.pack_into(">8xB3h3BBh", payload, 17, 3, 3650, 3700, 3680, 0, 1, 0, 1, 2530)
    struct.pack_into(">hhB", payload, 46, 853, 990, 7)
    crc = checksum_of("crc-16/xmodem")[1](bytes(payload))
    return b"\x02\x33" + payload + crc.to_bytes(2, "big") + b"\x03"


CASES = {
    "ANT": (ANT, ANT_FRAME, {
        "voltage": [3.3, 3.3, 3.301, 3.301, 3.304, 3.303, 3.303, 3.302, 3.304, *[3.303] * 5, 3.302, 3.305],
        "temperature": [1, 2], "pack_voltage": [52.84], "current": [0.3], "soc": [0.91],
    }),
    "Basen": (BASEN, BASEN_FRAMES, {
        "voltage": [3.222, 3.223, 3.224, 3.222, 3.222, 3.224, 3.224, 3.223],
        "temperature": [18, 20, 25, 25], "pack_voltage": [25.038], "current": [0], "soc": [0.08],
    }),
    "JK": (JK, JK_FRAME, {
        "voltage": [3.821, 3.834, 3.831, 3.82, 3.832, 3.834, 3.825, 3.832, 3.811, 3.834, 3.825, 3.835, 3.835, 3.826],
        "temperature": [29, 30, 28], "pack_voltage": [53.59], "current": [-2.08], "soc": [0.15],
    }),
    "Pylontech": (PYLONTECH, PYLONTECH_LINE, {
        "voltage": [3.226, 3.224, 3.225, 3.224, 3.226, 3.226, 3.225, 3.227, 3.228, 3.226, *[3.227] * 4, 3.225],
        "temperature": [20.1, 17.0, 17.2, 16.8, 18.4], "pack_voltage": [48.39], "current": [0],
    }),
    "Seplos": (SEPLOS, SEPLOS_LINE, {
        "voltage": [3.287, 3.305, 3.316, 3.286, 3.311, 3.301, 3.297, 3.292,
                    3.305, 3.312, 3.304, 3.311, 3.306, 3.290, 3.294, 3.288],
        "temperature": [25.1, 24.5, 23.6, 25.1, 25.0, 24.7], "pack_voltage": [52.80], "current": [6.76],
    }),
    "Chargery": (CHARGERY, CHARGERY_FRAMES, {
        "voltage": [3.325, 3.332, 3.332, 3.330, 3.331, 3.332, 3.334, 3.329,
                    3.336, 3.330, 3.333, 3.326, 3.334, 3.323, 3.343, 3.324],
        "temperature": [12.9, 13.2], "current": [-22.8], "soc": [0.91],
    }),
    "VESC": (VESC, vesc_frame(), {
        "voltage": [3.65, 3.70, 3.68], "balancing": [0, 1, 0], "pack_voltage": [60.0], "current": [5.0],
        "temperature": [25.3], "soc": [0.853],
    }),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("size", [1, 11, 1000])
def test_a_profile_reads_what_the_others_read(name, size):
    profile, stream, expected = CASES[name]
    battery = battery_from_files({"x.toml": profile.encode()})
    values, reader = decoded(battery, [stream[k : k + size] for k in range(0, len(stream), size)])
    assert {kind: each.value.tolist() for kind, each in values.items()} == {
        kind: pytest.approx(of_kind) for kind, of_kind in expected.items()
    }
    assert (reader.bad_frames, reader.skipped_bytes) == (0, 0)
    issues = serial_issues(battery.battery, battery.serial, "x.toml", stream)
    assert [issue.what.code for issue in issues] == (["check-sum-off"] if name == "VESC" else [])  # 60 V of three cells


@pytest.mark.parametrize("name", ["Pylontech", "Seplos", "JK", "Chargery"])
def test_a_changed_character_of_a_line_or_byte_of_a_frame_gives_no_value(name):
    profile, stream, _ = CASES[name]
    battery = battery_from_files({"x.toml": profile.encode()})
    for at in range(4, 40):
        damaged = bytearray(stream)
        damaged[at] = ord("0") if damaged[at] != ord("0") else ord("1")
        assert "voltage" not in decoded(battery, [bytes(damaged)])[0]


@given(before=st.binary(max_size=200), between=st.binary(max_size=200), sizes=st.integers(1, 60))
def test_nothing_around_a_line_changes_or_loses_it(before, between, sizes):
    profile, line, expected = CASES["Pylontech"]
    battery = battery_from_files({"x.toml": profile.encode()})
    stream = before.replace(b"~", b"") + line + between.replace(b"~", b"") + b"\r" + line
    values, reader = decoded(battery, [stream[k : k + sizes] for k in range(0, len(stream), sizes)])
    assert reader.frames == 2
    assert values["voltage"].value.tolist() == pytest.approx(expected["voltage"] * 2)


@given(stream=st.text(alphabet="~20024600C06E10ABCDEF\r", max_size=600))
def test_text_that_is_no_line_gives_no_value_behind_a_checksum(stream):
    battery = battery_from_files({"x.toml": PYLONTECH.encode()})
    values, reader = decoded(battery, [stream.encode()])
    assert (values, reader.frames) == ({}, 0)
