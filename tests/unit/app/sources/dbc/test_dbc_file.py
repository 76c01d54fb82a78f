import pytest

from app.errors import ImportFailed
from app.sources.dbc.dbc_file import parse_definitions

HEAD = 'VERSION ""\nNS_ :\nBS_:\nBU_: BMS\n'
GOOD = 'BO_ 256 Cells: 8 BMS\n SG_ V1 : 0|16@1+ (0.001,0) [0|5] "V" X\n SG_ V2 : 16|16@1+ (0.001,0) [0|5] "V" X\n'


def codes(definitions):
    return [(each.line, each.what.code) for each in definitions.oddities]


def parsed(text):
    return parse_definitions(text.encode() if isinstance(text, str) else text, "x.dbc")


@pytest.mark.parametrize(
    ("text", "line", "code"),
    [
        (HEAD + GOOD + 'VAL_ 3221225472 Nothing 0 "a" ;\n', 8, "dbc-of-pseudo-message"),
        (HEAD + GOOD + 'VAL_ 2147483648 Nothing 0 "a" ;\n', 8, "dbc-of-pseudo-message"),
        (
            HEAD + 'BO_ 3221225472 VECTOR__INDEPENDENT_SIG_MSG: 0 X\n SG_ Y : 0|8@1+ (1,0) [0|0] "" X\n' + GOOD,
            5,
            "dbc-pseudo-message",
        ),
        (HEAD + GOOD + 'BA_ "GenSigStartValue" SG_ 256 V1 0;\n', 8, "dbc-attribute-undefined"),
        (HEAD + GOOD + 'CM_ SG_ 999 V1 "far";\n', 8, "dbc-of-unknown-message"),
        (HEAD + GOOD + 'CM_ SG_ 256 V9 "one\ntwo";\n', 8, "dbc-of-unknown-signal"),
        (HEAD + GOOD + ' SG_ V2 : 32|16@1+ (0.001,0) [0|5] "V" X\n', 8, "dbc-name-twice"),
        (HEAD + GOOD + 'BO_ 256 Again: 8 BMS\n SG_ Z : 0|8@1+ (1,0) [0|0] "" X\n', 8, "dbc-id-twice"),
        (HEAD + GOOD + 'BO_ 257 Cells: 8 BMS\n SG_ Z : 0|8@1+ (1,0) [0|0] "" X\n', 8, "dbc-name-twice"),
        (HEAD + GOOD + 'BO_ 419361024 Far: 8 BMS\n SG_ Z : 0|8@1+ (1,0) [0|0] "" X\n', 8, "dbc-id-29-bit"),
        (HEAD + GOOD + 'BO_ 257 Short: 1 BMS\n SG_ Z : 0|16@1+ (1,0) [0|0] "" X\n', 8, "dbc-signals-beyond"),
        (HEAD + GOOD + "BO_ 257 Broken\n", 8, "dbc-line-unreadable"),
        ((HEAD + GOOD).replace('"V"', '"°C"').encode("latin-1"), 6, "dbc-not-utf-8"),
    ],
)
def test_what_is_odd_is_told_by_its_line_and_the_rest_is_loaded(text, line, code):
    definitions = parsed(text)
    assert (line, code) in codes(definitions)
    assert {"V1", "V2"} <= {signal.name for message in definitions.messages for signal in message.signals}


def test_missing_spaces_do_not_matter():
    found = parsed(HEAD + 'BO_ 256 Cells:8 BMS\n SG_ V1:0|16@1+(0.001,0)[0|5]"V"X\n')
    assert found.messages[0].signals[0].layout.scale == 0.001
    assert found.oddities == ()


def test_a_multiplexer_that_is_not_marked_as_one_is_found():
    found = parsed(
        HEAD
        + 'BO_ 256 Cells: 8 BMS\n SG_ Mux : 0|8@1+ (1,0) [0|3] "" X\n'
        + ' SG_ V1 m0 : 8|16@1+ (0.001,0) [0|5] "V" X\n SG_ V2 m1 : 8|16@1+ (0.001,0) [0|5] "V" X\n'
    )
    assert [(condition.multiplexer, condition.values) for condition in found.messages[0].signal("V2").conditions] == [
        ("Mux", (1,))
    ]
    assert codes(found) == [(6, "dbc-multiplexer-unmarked")]


def test_a_sound_file_has_no_oddity():
    assert parsed(HEAD + GOOD + 'VAL_ 256 V1 0 "none" ;\nCM_ SG_ 256 V1 "one\ntwo";\n').oddities == ()


@pytest.mark.parametrize("data", [b"", b"\x00\xff" * 50, b"BO_", b"PK\x03\x04"])
def test_what_is_no_dbc_is_refused(data):
    with pytest.raises(ImportFailed):
        parsed(data)
