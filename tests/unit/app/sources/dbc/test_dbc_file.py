"""DBCs as they are found: what is odd is told with its line, the rest stays as it is; other formats; what is none."""

import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.errors import ImportFailed
from app.sources.dbc.dbc_file import load_definitions, parse_definitions
from app.sources.dbc.definitions import BitLayout
from app.sources.dbc.repair import repaired

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
        assert signal.layout == BitLayout(start, 16, scale=0.001)
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
        (bytes(range(256)), "unsupported binary file"),
        (b"time,current\n0,1\n", "not a readable|unsupported content"),
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


ONE = 'BO_ 256 Cells: 8 BMS\n SG_ V1 : 0|16@1+ (0.001,0) [0|5] "V" X\n'
NEXT = ONE.count("\n") + HEAD.count("\n") + 1  # line of what is appended


def oddities(more, text=HEAD + ONE):
    return [(each.file, each.line, each.what.code, each.what.args) for each in repaired(text + more, "x.dbc")[1]]


def loaded(text):
    return cantools.database.load_string(repaired(text, "x.dbc")[0], database_format="dbc", strict=False)


def test_a_sound_file_stays_as_it_is_but_for_spaces():
    text, found = repaired(HEAD + ONE + 'CM_ SG_ 256 V1 "one\ntwo";\n', "x.dbc")
    assert found == []
    assert text.count("\n") == (HEAD + ONE).count("\n") + 2
    assert 'CM_ SG_ 256 V1 "one\ntwo";' in text


@pytest.mark.parametrize(
    ("more", "code", "args"),
    [
        ('BA_ "Never" SG_ 256 V1 0;\n', "dbc-attribute-undefined", {"name": "Never"}),
        ('BA_DEF_DEF_ "Never" 0;\n', "dbc-attribute-undefined", {"name": "Never"}),
        ('VAL_ 3221225472 Y 0 "a" ;\n', "dbc-of-pseudo-message", {"id": "0xC0000000"}),
        ('CM_ BO_ 999 "far";\n', "dbc-of-unknown-message", {"id": "0x3E7"}),
        ("SIG_VALTYPE_ 999 V1 : 1;\n", "dbc-of-unknown-message", {"id": "0x3E7"}),
        ("SG_MUL_VAL_ 999 V1 M 0-1;\n", "dbc-of-unknown-message", {"id": "0x3E7"}),
        ("BO_TX_BU_ 999 : BMS;\n", "dbc-of-unknown-message", {"id": "0x3E7"}),
        ('VAL_ 256 V9 0 "a" ;\n', "dbc-of-unknown-signal", {"name": "V9", "id": "0x100"}),
        ('CM_ SG_ 256 V9 "no";\n', "dbc-of-unknown-signal", {"name": "V9", "id": "0x100"}),
        ("SIG_VALTYPE_ 256 V9 : 1;\n", "dbc-of-unknown-signal", {"name": "V9", "id": "0x100"}),
        ("BO_ what\n", "dbc-line-unreadable", {"text": "BO_ what"}),
        (' SG_ V2 : 16|16 (1,0) "V" X\n', "dbc-line-unreadable", {"text": 'SG_ V2 : 16|16 (1,0) "V" X'}),
        (' SG_ V2 : 16|0@1+ (1,0) [0|0] "V" X\n', "dbc-signal-length", {"name": "V2", "bits": 0}),
        (' SG_ V2 : 16|65@1+ (1,0) [0|0] "V" X\n', "dbc-signal-length", {"name": "V2", "bits": 65}),
        (' SG_ V2 : 16|16@1+ (0,0) [0|0] "V" X\n', "dbc-factor-zero", {"name": "V2"}),
        (' SG_ V-2 : 16|16@1+ (1,0) [0|0] "V" X\n', "dbc-name-repaired", {"name": "V-2", "as_name": "V_2"}),
        (' SG_ 2V : 16|16@1+ (1,0) [0|0] "V" X\n', "dbc-name-repaired", {"name": "2V", "as_name": "_2V"}),
        (' SG_ V1 : 16|16@1+ (1,0) [0|0] "V" X\n', "dbc-name-twice", {"name": "V1", "as_name": "V1_2"}),
        ("BO_ 257 Cells: 8 BMS\n", "dbc-name-twice", {"name": "Cells", "as_name": "Cells_2"}),
        ("BO_ 256 More: 8 BMS\n", "dbc-id-twice", {"name": "More", "id": "0x100"}),
        ("BO_ 2048 Far: 8 BMS\n", "dbc-id-29-bit", {"name": "Far", "id": "0x800"}),
        ("BO_ 3221225472 VECTOR__INDEPENDENT_SIG_MSG: 0 X\n", "dbc-pseudo-message",
         {"name": "VECTOR__INDEPENDENT_SIG_MSG"}),
    ],
)  # fmt: skip
def test_each_oddity_is_told_with_its_line(more, code, args):
    assert oddities(more) == [("x.dbc", NEXT, code, args)]
    assert loaded(HEAD + ONE + more).get_message_by_name("Cells").get_signal_by_name("V1").scale == 0.001


def test_a_multiplexer_without_its_mark_is_told_and_taken_as_one():
    text = HEAD + (
        'BO_ 1 M: 8 BMS\n SG_ Page : 0|8@1+ (1,0) [0|0] "" X\n SG_ Alive : 8|8@1+ (1,0) [0|0] "" X\n'
        ' SG_ A m0 : 16|8@1+ (1,0) [0|0] "" X\n SG_ B m1 : 16|8@1+ (1,0) [0|0] "" X\n'
    )
    assert oddities("", text) == [("x.dbc", 6, "dbc-multiplexer-unmarked", {"name": "Page"})]
    assert loaded(text).get_message_by_name("M").get_signal_by_name("Page").is_multiplexer


def test_where_two_signals_could_be_the_multiplexer_none_is_taken():
    text = HEAD + (
        'BO_ 1 M: 8 BMS\n SG_ One : 0|8@1+ (1,0) [0|0] "" X\n SG_ Two : 8|8@1+ (1,0) [0|0] "" X\n'
        ' SG_ A m0 : 16|8@1+ (1,0) [0|0] "" X\n'
    )
    assert oddities("", text) == []


def test_the_signals_of_a_message_that_is_left_out_go_with_it():
    more = 'BO_ 256 Again: 8 BMS\n SG_ Wrong : 0|8@1+ (9,0) [0|0] "" X\n'
    assert [each.name for each in loaded(HEAD + ONE + more).get_message_by_name("Cells").signals] == ["V1"]


def test_a_comment_over_several_lines_is_left_out_whole():
    more = 'CM_ SG_ 999 V1 "one\nBO_ 300 NotAMessage: 8 X\nthree";\n'
    assert [code for _, _, code, _ in oddities(more)] == ["dbc-of-unknown-message"]
    assert [message.name for message in loaded(HEAD + ONE + more).messages] == ["Cells"]


def test_a_comment_that_looks_like_lines_of_a_dbc_is_kept_as_it_is():
    more = 'CM_ SG_ 256 V1 "one\nBO_ 300 NotAMessage: 8 X\nthree";\n'
    assert oddities(more) == []
    found = loaded(HEAD + ONE + more)
    assert [message.name for message in found.messages] == ["Cells"]
    assert "NotAMessage" in found.messages[0].signals[0].comment


def test_an_attribute_with_a_definition_is_kept():
    more = 'BA_DEF_ SG_ "Start" INT 0 9;\nBA_DEF_DEF_ "Start" 0;\nBA_ "Start" SG_ 256 V1 7;\n'
    assert oddities(more) == []
    assert loaded(HEAD + ONE + more).messages[0].signals[0].dbc.attributes["Start"].value == 7


@pytest.mark.parametrize("ending", ["\r\n", "\r", "\n"])
def test_line_ends_of_any_system_count_the_same_lines(ending):
    text = (HEAD + ONE + "BO_ what\n").replace("\n", ending)
    assert [each.line for each in repaired(text, "x.dbc")[1]] == [NEXT]


@pytest.mark.parametrize(
    "line",
    [
        ' SG_ V2:16|16@1+(0.001,0)[0|5]"V"X',
        '\tSG_ V2\t: 16|16@1+ (0.001,0) [0|5] "V"  X,Y',
        ' SG_ V2 : 16 | 16 @ 1 + ( 0.001 , 0 ) [ 0 | 5 ] "V" X',
        ' SG_ V2 : 16|16@1+ (1E-3,0) "V" X',
        ' SG_ V2 : 16|16@1+ (0.001,0) [0|5] " V " ',
    ],
)
def test_a_signal_is_read_however_it_is_spaced(line):
    found = parse_definitions((HEAD + ONE + line + "\n").encode(), "x.dbc")
    signal = found.messages[0].signal("V2")
    assert (signal.layout.start, signal.layout.length, signal.layout.scale, signal.unit) == (16, 16, 0.001, "V")
    assert found.oddities == ()


@given(st.lists(st.sampled_from(["V", "V-", "1V", "Vø", "V V2"]), min_size=1, max_size=5))
def test_signals_with_any_names_have_names_of_their_own_and_their_place(names):
    names = [name.split()[0] for name in names]
    lines = "".join(f' SG_ {name} : {8 * k}|8@1+ (1,0) [0|0] "" X\n' for k, name in enumerate(names))
    (message,) = loaded(HEAD + "BO_ 1 M: 8 BMS\n" + lines).messages
    assert len({signal.name for signal in message.signals}) == len(names)
    assert sorted(signal.start for signal in message.signals) == [8 * k for k in range(len(names))]


@given(st.text(max_size=120))
def test_any_text_is_taken_without_a_failure_and_keeps_its_number_of_lines(text):
    lines = text.replace("\r\n", "\n").replace("\r", "\n").count("\n")
    assert repaired(text, "x.dbc")[0].count("\n") == lines


@pytest.mark.parametrize(
    "noted", ['CM_ "Left target"', 'CM_ BO_ 256 "over\ntwo lines";', 'BA_DEF_ BO_ "Cycle" INT 0 9']
)
def test_a_note_without_its_semicolon_does_not_take_the_next_message_with_it(noted):
    text = HEAD + ONE + noted + "\n" + ONE.replace("256 Cells", "257 More")
    assert [each.name for each in loaded(text).messages] == ["Cells", "More"]
