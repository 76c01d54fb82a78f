import contextlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.errors import ImportFailed
from app.sources.dbc.dbc_file import load_definitions, parse_definitions
from app.sources.dbc.definitions import Layout
from tests.campaign import examples

HEAD = 'VERSION ""\nNS_ :\nBS_:\nBU_: BMS\n'
GOOD = 'BO_ 256 Cells: 8 BMS\n SG_ V1 : 0|16@1+ (0.001,0) [0|5] "V" X\n SG_ V2 : 16|16@1+ (0.001,0) [0|5] "V" X\n'


def codes(definitions):
    return [(each.line, each.what.code) for each in definitions.oddities]


def parsed(text):
    return parse_definitions(text.encode() if isinstance(text, str) else text, "x.dbc")


@pytest.mark.parametrize(
    ("text", "line", "code"),
    [
        (HEAD + GOOD + 'BO_ 257 Short: 1 BMS\n SG_ Z : 0|16@1+ (1,0) [0|0] "" X\n', 8, "dbc-signals-beyond"),
        (HEAD + GOOD + 'BO_ 257 Odd: 11 BMS\n SG_ Z : 0|8@1+ (1,0) [0|0] "" X\n', 8, "dbc-length"),
        (HEAD + GOOD + "<<<<<<< HEAD\nFOO bar;\n=======\n", 9, "dbc-line-unreadable"),
        (HEAD + GOOD + ' SG_ V9 : -1|16@0+ (1,0) [0|0] "" X\n', 8, "dbc-line-unreadable"),
        ((HEAD + GOOD).replace('"V"', '"°C"').encode("latin-1"), 6, "dbc-not-utf-8"),
    ],
)
def test_what_is_odd_is_told_by_its_line_and_the_rest_is_loaded(text, line, code):
    definitions = parsed(text)
    assert (line, code) in codes(definitions)
    assert {"V1", "V2"} <= {signal.name for message in definitions.messages for signal in message.signals}
    assert definitions.messages[0].signal("V1").unit == ("°C" if code == "dbc-not-utf-8" else "V")


def test_a_list_of_names_without_its_end_and_a_factor_that_is_no_number_do_not_matter():
    text = (
        HEAD + GOOD + ' SG_ V3 : 32|16@1+ (nan,0) [0|5] "V" X\nVAL_ 256 V1 0 "none" 1 "one"\nVAL_ 256 V2 0 "none" ;\n'
    )
    message = parsed(text).messages[0]
    assert message.signal("V1").choices == {0: "none", 1: "one"}
    assert message.signal("V2").choices == {0: "none"}
    assert message.signal("V3").layout.scale == 1.0


SYM = """FormatVersion=6.0 // Do not edit this line!
Title="Cells"

{SENDRECEIVE}

[Cells]
ID=100h
Len=8
Var=V1 unsigned 0,16 /u:V /f:0.001
Var=V2 unsigned 16,16 /u:V /f:0.001
"""
KCD = """<NetworkDefinition xmlns="http://kayak.2codeornot2code.org/1.0">
  <Document name="x"/>
  <Bus name="hv"><Message id="0x100" length="8" name="Cells">
    <Signal name="V1" offset="0" length="16"><Value slope="0.001" unit="V"/></Signal>
    <Signal name="V2" offset="16" length="16"><Value slope="0.001" unit="V"/></Signal>
  </Message></Bus>
</NetworkDefinition>
"""


@pytest.mark.parametrize(("name", "text"), [("x.dbc", HEAD + GOOD), ("x.sym", SYM), ("x.kcd", KCD)])
def test_the_same_message_is_the_same_from_every_format(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text)
    (message,) = load_definitions(path).messages
    assert (message.can_id, message.name, message.length) == (0x100, "Cells", 8)
    for signal, start in zip(message.signals, (0, 16), strict=True):
        assert signal.layout == Layout(start, 16, scale=0.001)
        assert signal.unit == "V"


def test_ids_choices_limits_and_the_sender_are_kept():
    found, far = parsed(
        HEAD
        + GOOD
        + 'BO_ 2566869221 Far: 12 BMS\n SG_ T1 : 0|8@1+ (1,-40) [0|0] "C" X\nVAL_ 256 V1 0 "none" 65535 "open" ;\n'
    ).messages
    assert far.can_id == 0x80000000 | 0x18FF50E5
    signal = found.signal("V1")
    assert signal.choices == {0: "none", 65535: "open"}
    assert (signal.minimum, signal.maximum) == (0.0, 5.0)
    assert found.sender == "BMS"


def test_floats_are_floats_and_have_no_sign_of_their_own():
    found = parsed(HEAD + 'BO_ 256 M: 8 BMS\n SG_ F : 0|32@1- (1,0) [0|0] "V" X\n\nSIG_VALTYPE_ 256 F : 1;\n')
    layout = found.messages[0].signal("F").layout
    assert (layout.is_float, layout.is_signed, layout.length) == (True, False, 32)


def test_a_byte_order_mark_and_windows_line_ends_do_not_matter():
    plain = parsed(HEAD + GOOD)
    assert parsed(b"\xef\xbb\xbf" + (HEAD + GOOD).replace("\n", "\r\n").encode()) == plain


@settings(max_examples=examples(30))
@given(st.binary(max_size=200))
def test_any_bytes_are_definitions_or_refused(data):
    for text in (data, (HEAD + GOOD).encode() + data):
        with contextlib.suppress(ImportFailed):
            assert parsed(text).messages


def test_a_float_of_eight_bits_is_read_as_a_whole_number_and_told():
    found = parsed(HEAD + GOOD + ' SG_ Sum : 32|8@1- (1,0) [0|0] "V" X\n\nSIG_VALTYPE_ 256 Sum : 1;\n')
    assert codes(found) == [(5, "dbc-float-bits")]
    layout = found.messages[0].signal("Sum").layout
    assert (layout.is_float, layout.is_signed, layout.length) == (False, True, 8)


TWO_BUSES = """<NetworkDefinition xmlns="http://kayak.2codeornot2code.org/1.0"><Document/>
<Bus name="One"><Message id="0x100" name="First"><Signal name="A" offset="0"/></Message></Bus>
<Bus name="Two"><Message id="0x100" name="Second"><Signal name="B" offset="0"/></Message></Bus>
</NetworkDefinition>"""


def test_of_two_buses_in_one_file_the_first_message_of_an_id_counts_and_it_is_told(caplog):
    found = parse_definitions(TWO_BUSES.encode(), "x.kcd")
    assert [each.name for each in found.messages] == ["First"]
    assert [(each.what.code, each.what.args) for each in found.oddities] == [
        ("dbc-id-twice", {"name": "Second", "id": "0x100"})
    ]
    assert not caplog.records


@pytest.mark.parametrize(
    ("name", "text", "reason"),
    [("x.sym", "FormatVersion=5.0\n", "version 6.0"), ("x.arxml", "<A xmlns='argh'/>", "XML namespace")],
)
def test_a_file_that_cannot_be_read_says_why_in_its_own_format_only(name, text, reason):
    with pytest.raises(ImportFailed) as raised:
        parse_definitions(text.encode(), name)
    assert reason in str(raised.value)
    assert "DBC: " not in str(raised.value).partition("not a readable DBC: ")[2]


@pytest.mark.parametrize("name", ["bus.bin", "bus.dbc"])
@pytest.mark.parametrize(
    ("data", "why"),
    [
        (bytes(range(256)), "a binary file, no text"),
        (b"time,current\n0,1\n", "not a readable|of none of"),
        (b"", ""),
        (b"BO_", ""),
        (b"PK\x03\x04", ""),
    ],
)
def test_what_is_of_no_format_is_refused_in_one_line(name, data, why):
    with pytest.raises(ImportFailed, match=rf"{name}: .*({why})") as refused:
        parse_definitions(data, name)
    assert "\n" not in str(refused.value)
    assert str(refused.value).count('"') <= 4  # no complaints of four parsers
