"""What is wrong in `[serial]` tables is named by its line and field."""

import pytest

from app.battery.profile import read_document, understand
from app.battery.table_reader import ProfileError
from app.sources.loaded_battery import battery_from_files
from app.words import render

HEAD = """[battery]
name = "x"
segments = [12]
[serial]
baud = 9600
"""
FRAME = """[[serial.frame]]
header = "A5"
length = 30
fields = [{ signal = "cells.voltage", type = "u16", at = 4, count = 12 }]
"""


def understood(text):
    return understand(read_document(text, "x.toml", lambda name: pytest.fail(name)))


@pytest.mark.parametrize(
    ("text", "field"),
    [
        (HEAD, "serial.frame"),
        (HEAD + FRAME + '[[serial.line]]\nfields = [{ signal = "current", column = 0 }]\n', "serial.frame"),
        (HEAD + FRAME + '[source]\ndbc = "x.dbc"\n', "source"),
        (HEAD + FRAME.replace('"A5"', '"A"'), "serial.frame[0].header"),
        (HEAD + FRAME.replace('"A5"', '"?? ??"'), "serial.frame[0].header"),
        (HEAD + FRAME.replace('header = "A5"\n', ""), "serial.frame[0].header"),
        (HEAD + FRAME.replace("length = 30\n", ""), "serial.frame[0].length"),
        (HEAD + FRAME.replace("30", "20"), "serial.frame[0].fields"),
        (HEAD + FRAME.replace("count = 12", "count = 13"), "serial.frame[0].fields[0].count"),
        (HEAD + FRAME.replace('type = "u16"', 'type = "u17"'), "serial.frame[0].fields[0].type"),
        (HEAD + FRAME.replace("cells.voltage", "cell.voltage"), "serial.frame[0].fields[0].signal"),
        (HEAD + FRAME.replace('"u16"', '"u16", offsets = 1'), "serial.frame[0].fields[0].offsets"),
        (HEAD.replace("9600", '9600\nstart = ["x"]') + FRAME, "serial.start"),
        (HEAD.replace("9600", '9600\nparity = "mark"') + FRAME, "serial.parity"),
        (HEAD + '[[serial.line]]\nfields = [{ signal = "current" }]\n', "serial.line[0].fields[0].column"),
    ],
)
def test_a_mistake_is_named_by_its_field_and_line(text, field):
    with pytest.raises(ProfileError) as raised:
        understood(text)
    assert raised.value.path == field
    assert raised.value.line is not None
    assert render(raised.value.limit)


@pytest.mark.parametrize("kind", ["sum9", "crc-17"])
def test_a_checksum_that_nobody_knows_is_refused(kind):
    text = HEAD + FRAME + f'checksum = {{ kind = "{kind}" }}\n'
    with pytest.raises(ProfileError, match="crccheck"):
        battery_from_files({"x.toml": text.encode()})


@pytest.mark.parametrize(("start", "sent"), [('"x"', b"x"), ('{ hex = "DD A5" }', b"\xdd\xa5")])
def test_what_is_sent_is_a_text_or_bytes(start, sent):
    assert understood(HEAD.replace("9600", f"9600\nstart = {start}") + FRAME).source.port.start == sent


def test_a_pattern_reads_named_groups_in_linear_time():
    pytest.importorskip("re2", reason="the extra serial-pattern")
    line = '[[serial.line]]\npattern = "^I=(?P<i>[-0-9]+) V=(?P<v>(?:[0-9]+,?)+)$"\nfields = [\n'
    fields = (
        '{ signal = "current", group = "i", scale = 0.1 }, { signal = "cells.voltage", group = "v", scale = 0.001 }]\n'
    )
    loaded = battery_from_files({"x.toml": (HEAD + line + fields).encode()})
    from app.sources.serial.decoder import SerialDecoder
    from app.sources.serial.framing import StreamReader

    text = b"I=-25 V=" + b",".join(b"%d" % (3700 + k) for k in range(12)) + b"\n"
    hostile = b"I=1 V=" + b"1" * 16_000 + b"x\n"
    reader, decoder = StreamReader(loaded.serial), SerialDecoder(loaded.battery, loaded.serial)
    values = decoder.decode(reader.feed(hostile + text + text, 1))
    assert values["current"].value.tolist() == [-2.5, -2.5]
    assert values["voltage"].value[-1] == pytest.approx(3.711)
