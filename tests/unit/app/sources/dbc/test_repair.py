"""DBCs as they are found: each kind of oddity is told with its line, and the rest stays as it is."""

import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.repair import repaired

HEAD = 'VERSION ""\nNS_ :\nBS_:\nBU_: BMS\n'
GOOD = 'BO_ 256 Cells: 8 BMS\n SG_ V1 : 0|16@1+ (0.001,0) [0|5] "V" X\n'
NEXT = GOOD.count("\n") + HEAD.count("\n") + 1  # line of what is appended


def oddities(more, text=HEAD + GOOD):
    return [(each.file, each.line, each.what.code, each.what.args) for each in repaired(text + more, "x.dbc")[1]]


def loaded(text):
    return cantools.database.load_string(repaired(text, "x.dbc")[0], database_format="dbc", strict=False)


def test_a_sound_file_stays_as_it_is_but_for_spaces():
    text, found = repaired(HEAD + GOOD + 'CM_ SG_ 256 V1 "one\ntwo";\n', "x.dbc")
    assert found == []
    assert text.count("\n") == (HEAD + GOOD).count("\n") + 2
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
        (' SG_ V-2 : 16|16@1+ (1,0) [0|0] "V" X\n', "dbc-name-mended", {"name": "V-2", "as_name": "V_2"}),
        (' SG_ 2V : 16|16@1+ (1,0) [0|0] "V" X\n', "dbc-name-mended", {"name": "2V", "as_name": "_2V"}),
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
    assert loaded(HEAD + GOOD + more).get_message_by_name("Cells").get_signal_by_name("V1").scale == 0.001


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
    assert [each.name for each in loaded(HEAD + GOOD + more).get_message_by_name("Cells").signals] == ["V1"]


def test_a_comment_over_several_lines_is_left_out_whole():
    more = 'CM_ SG_ 999 V1 "one\nBO_ 300 NotAMessage: 8 X\nthree";\n'
    assert [code for _, _, code, _ in oddities(more)] == ["dbc-of-unknown-message"]
    assert [message.name for message in loaded(HEAD + GOOD + more).messages] == ["Cells"]


def test_a_comment_that_looks_like_lines_of_a_dbc_is_kept_as_it_is():
    more = 'CM_ SG_ 256 V1 "one\nBO_ 300 NotAMessage: 8 X\nthree";\n'
    assert oddities(more) == []
    found = loaded(HEAD + GOOD + more)
    assert [message.name for message in found.messages] == ["Cells"]
    assert "NotAMessage" in found.messages[0].signals[0].comment


def test_an_attribute_with_a_definition_is_kept():
    more = 'BA_DEF_ SG_ "Start" INT 0 9;\nBA_DEF_DEF_ "Start" 0;\nBA_ "Start" SG_ 256 V1 7;\n'
    assert oddities(more) == []
    assert loaded(HEAD + GOOD + more).messages[0].signals[0].dbc.attributes["Start"].value == 7


@pytest.mark.parametrize("ending", ["\r\n", "\r", "\n"])
def test_line_ends_of_any_system_count_the_same_lines(ending):
    text = (HEAD + GOOD + "BO_ what\n").replace("\n", ending)
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
    found = parse_definitions((HEAD + GOOD + line + "\n").encode(), "x.dbc")
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


@given(st.sampled_from(["BO_ ", " SG_ ", "VAL_ ", "CM_ ", 'BA_ "', "SIG_VALTYPE_ "]), st.text(max_size=60))
def test_a_line_of_a_dbc_that_goes_on_in_any_way_is_no_failure(begin, text):
    repaired(HEAD + GOOD + begin + text, "x.dbc")


@pytest.mark.parametrize(
    "noted", ['CM_ "Left target"', 'CM_ BO_ 256 "over\ntwo lines";', 'BA_DEF_ BO_ "Cycle" INT 0 9']
)
def test_a_note_without_its_semicolon_does_not_take_the_next_message_with_it(noted):
    text = HEAD + GOOD + noted + "\n" + GOOD.replace("256 Cells", "257 More")
    assert [each.name for each in loaded(text).messages] == ["Cells", "More"]
