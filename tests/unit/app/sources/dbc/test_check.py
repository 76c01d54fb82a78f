import numpy as np
import pytest

from app.battery.profile import read_document, understand
from app.sources.dbc.battery_decoder import BatteryDecoder
from app.sources.dbc.check import issues_of
from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.frames import frames_of
from app.words import render
from tests.peer_batteries import cell_number
from tests.peer_messages import HEAD

VOLTAGES = '[[source.voltage]]\nsignal = "V{cell}"\nbase = 1\n'
HOT = "[battery.limits]\ntemperature_max_degc = 70\n[battery.rules]\ntemperature_max_degc = 60\n"
FULL = "[battery.limits]\ncell_voltage_max_v = 4.2\n[battery.rules]\nsegment_voltage_max_v = 30\n"
NOTHING = "cells = [[1, 2, 3, 4, 5, 6, 7, 8], []]\n"
READINGS = '[source.current]\nsignal = "Pack_Current"\n[source.pack_voltage]\nsignal = "Pack_Voltage"\n'


STATES_DBC = HEAD + """BO_ 1 Cells: 8 BMS
 SG_ V1 : 0|16@1+ (0.001,0) [0|5] "V" X
 SG_ V2 : 16|16@1+ (0.001,0) [0|5] "V" X
 SG_ T1 : 32|8@1+ (1,-40) [0|0] "degC" X
 SG_ Bad_V1 : 40|1@1+ (1,0) [0|1] "" X

BO_ 2 Pack: 8 BMS
 SG_ Pack_Current : 0|16@1- (0.1,0) [0|0] "A" X
 SG_ Pack_Voltage : 16|16@1+ (0.1,0) [0|0] "V" X
 SG_ SOC : 32|8@1+ (0.5,0) [0|0] "%" X

BO_ 3 Twin: 8 BMS
 SG_ SOC : 0|8@1+ (0.5,0) [0|0] "%" X
"""  # fmt: skip
SOC = '[source.soc]\nsignal = "Pack.SOC"\n'
HEATS = '[[source.temperature]]\nsignal = "T{cell}"\nbase = 1\n'


def issues(profile, frames=None, dbc=None):
    profile = understand(read_document(profile, "x.toml", lambda name: None))
    definitions = parse_definitions((dbc or STATES_DBC).encode(), "x.dbc")
    frames = None if frames is None else frames_of(frames)
    return issues_of(profile.battery, profile.source, definitions, "x.toml", frames)


def of_code(found, code):
    return [issue for issue in found if issue.what.code == code]


def codes(*args):
    return {(issue.what.code, issue.is_error) for issue in issues(*args)}


def battery(cells, sensors=0, more=""):
    head = f'[battery]\nname = "x"\nsegments = [{cells}]\n[battery.temperatures]\nsensors = {sensors}\n'
    return head + more + '[source]\ndbc = "x.dbc"\n'


def received(n=20, volts=(3700, 3720), pack=74, heat=65, soc=100, period_s=0.1):
    cells = b"".join(volt.to_bytes(2, "little") for volt in volts) + bytes([heat, 0])
    status = bytes(2) + pack.to_bytes(2, "little") + bytes([soc])
    return [
        (round((k + part) * period_s * 1e9), can_id, data)
        for k in range(n)
        for part, can_id, data in ((0.0, 1, cells), (0.5, 2, status))
    ]


@pytest.mark.parametrize(
    ("profile", "code", "is_error"),
    [
        (battery(1) + VOLTAGES + READINGS, "cell-beyond", False),
        (battery(2) + VOLTAGES + 'invalid_signal = "No{cell}"\n' + READINGS, "signal-not-in-dbc", True),
        (battery(2) + VOLTAGES.replace("{cell}", "{zell}") + READINGS, "no-such-placeholder", True),
        (battery(2) + VOLTAGES, "check-no-current", False),
        (battery(2) + READINGS, "check-no-voltages", False),
        (battery(2) + VOLTAGES + READINGS.replace("Pack_C", "Sack_C"), "signal-not-in-dbc", True),
        (battery(8, 1, "cells = [[1, 2]]\n") + VOLTAGES + READINGS, "check-no-sensor", False),
        (battery(2, 2, "cells = [[1, 2], []]\n") + VOLTAGES + READINGS, "check-sensor-of-nothing", False),
        (battery(2, 0, HOT) + VOLTAGES + READINGS, "check-beyond-rule", False),
        (battery(8, 0, FULL) + VOLTAGES + READINGS, "check-cells-beyond-rule", False),
    ],
)
def test_doubts_of_a_profile_without_a_log(profile, code, is_error):
    assert (code, is_error) in codes(profile)


def test_cells_that_the_profile_does_not_have_and_oddities_of_the_dbc_are_told():
    peer = cell_number()
    text = battery(70, 12) + peer.profile + READINGS.replace("Pack_V", "Pack_Inst_V")
    found = codes(text, peer.frames(8), peer.dbc() + 'CM_ BO_ 2000 "far";\n')
    assert {("check-numbers-beyond", False), ("dbc-of-unknown-message", False)} <= found


def test_an_empty_log_and_a_log_of_another_car_are_told():
    text = battery(2) + VOLTAGES + READINGS
    assert ("check-empty-log", False) in codes(text, [])
    assert {("check-nothing-of-it", False), ("check-not-received", False)} <= codes(text, [(0, 0x7F0, b"\0")])


def test_a_sound_battery_with_all_its_readings_has_no_doubts_in_its_log():
    assert issues(battery(2, 1) + VOLTAGES + HEATS + READINGS + SOC, received()) == []


def test_errors_come_first_and_name_line_and_field():
    found = issues(battery(2, 1) + VOLTAGES + HEATS.replace("T{", "X{"), received())
    assert [issue.is_error for issue in found] == sorted((issue.is_error for issue in found), reverse=True)
    assert (found[0].what.code, found[0].file, found[0].field) == (
        "no-signal-fits",
        "x.toml",
        "source.temperature[0].signal",
    )
    assert found[0].line == battery(2, 1).count("\n") + VOLTAGES.count("\n") + 1


def test_a_signal_of_two_messages_is_a_doubt_and_with_its_message_none():
    text = battery(2) + VOLTAGES + READINGS
    (issue,) = of_code(issues(text + SOC.replace("Pack.", "")), "signal-of-several")
    assert set(issue.what.args["names"]) == {"Pack", "Twin"}
    assert not issue.is_error
    assert of_code(issues(text + SOC), "signal-of-several") == []


def test_two_signals_of_one_cell_are_named():
    text = battery(2) + VOLTAGES + VOLTAGES.replace("V{cell}", "V1").replace("base = 1", "first = 2") + READINGS
    (issue,) = of_code(issues(text), "check-two-signals")
    assert issue.what.args["number"] == 2
    assert set(issue.what.args["names"]) == {"Cells.V1", "Cells.V2"}


def test_a_reading_that_is_never_heard_is_named():
    found = issues(battery(2) + VOLTAGES + READINGS + SOC, [frame for frame in received() if frame[1] == 1])
    assert sorted(issue.field for issue in of_code(found, "check-not-received")) == [
        "source.current",
        "source.pack_voltage",
        "source.soc",
    ]


def test_a_kind_that_is_never_heard_is_told_once_and_not_by_cell():
    found = issues(battery(2, 1) + VOLTAGES + HEATS + READINGS, [frame for frame in received() if frame[1] == 2])
    assert [issue.field for issue in of_code(found, "check-nothing-of-it")] == ["source.voltage", "source.temperature"]
    assert of_code(found, "check-cells-not-received") == []


@pytest.mark.parametrize(("volts", "length"), [((3700, 65535), 8), ((3700, 3720), 2)])
def test_a_cell_that_is_invalid_all_the_time_or_in_no_frame_was_never_heard(volts, length):
    text = battery(2) + VOLTAGES + "invalid = [65535]\n" + READINGS
    frames = [(t, i, data[:length] if i == 1 else data) for t, i, data in received(volts=volts)]
    (issue,) = of_code(issues(text, frames), "check-cells-not-received")
    assert issue.what.args["numbers"] == "2"


@pytest.mark.parametrize(
    ("more", "given", "code", "args"),  # None: not told
    [
        ("", {"pack": 74}, "check-sum-off", None),
        ("", {"pack": 75}, "check-sum-off", None),
        ("", {"pack": 78}, "check-sum-off", {}),  # by more than two percent
        ("", {"pack": 70}, "check-sum-off", {}),
        ("", {"volts": (900, 3700)}, "check-implausible", {"numbers": "1"}),
        ("", {"volts": (900, 6000)}, "check-implausible", {"numbers": "1-2"}),
        ("", {"volts": (1500, 4400)}, "check-implausible", None),
        ("", {"n": 5, "period_s": 1.0}, "check-slow", None),
        ("", {"n": 5, "period_s": 9.0}, "check-slow", None),
        ("", {"n": 5, "period_s": 11.0}, "check-slow", {"n": 2}),  # slower than the filter bridges
        ("max_age_s = 0.5\n", {"period_s": 1.0}, "check-age-too-short", {}),
        ("max_age_s = 2.0\n", {"period_s": 1.0}, "check-age-too-short", None),
    ],
)
def test_what_a_log_says_against_a_profile_is_told(more, given, code, args):
    found = of_code(issues(battery(2) + VOLTAGES + more + READINGS, received(**given)), code)
    assert [issue.what.args | (args or {}) for issue in found] == ([] if args is None else [found[0].what.args])


def test_a_sum_is_not_judged_while_a_cell_is_unknown():
    text = battery(3) + VOLTAGES + READINGS
    assert of_code(issues(text, received(pack=111)), "check-sum-off") == []


@pytest.mark.parametrize(
    ("amps", "code"),
    [(6000, "check-current-implausible"), (-6000, "check-current-implausible"), (900, None)],
)
def test_more_current_than_a_battery_carries_is_a_finding(amps, code):
    dbc = STATES_DBC.replace("0|16@1- (0.1,0)", "0|16@1- (1,0)")
    frames = [
        (t, i, amps.to_bytes(2, "little", signed=True) + data[2:] if i == 2 else data) for t, i, data in received()
    ]
    found = issues(battery(2) + VOLTAGES + READINGS, frames, dbc)
    assert [issue.what.code for issue in found] == ([] if code is None else [code])


def turns(n_frames, cells, *, gap_ms=1.0, period_ms=200.0, rounds=40, apart_mv=7):
    """Frames of one message without a number, several a round; the voltages of a round differ."""
    return [
        (
            round(1e6 * (k * period_ms + j * gap_ms)),
            1,
            b"".join((3700 + apart_mv * j + c + k % 2).to_bytes(2, "little") for c in range(cells)) + bytes([65, 0]),
        )
        for k in range(rounds)
        for j in range(n_frames)
    ]


@pytest.mark.parametrize(
    ("frames", "n"),
    [
        (turns(4, 2), 4),
        (turns(2, 2, gap_ms=10.0), 2),
        (turns(1, 2), None),
        (turns(2, 2, gap_ms=0.0, apart_mv=0), None),  # an adapter that stamps two frames at once
        (turns(3, 2, gap_ms=200 / 3), None),  # evenly: three a second more
    ],
)
def test_values_that_overwrite_each_other_within_a_round_are_a_finding(frames, n):
    found = of_code(issues(battery(2) + VOLTAGES + READINGS, frames), "check-overwritten")
    assert [issue.what.args["n"] for issue in found] == ([] if n is None else [n])


ABSENT = [(t, i, data[:4] + bytes([0, 0]) if i == 1 else data) for t, i, data in received()]


def test_a_sensor_that_is_not_connected_measures_nothing_and_is_counted():
    text = battery(2, 1) + VOLTAGES + HEATS + READINGS
    (issue,) = of_code(issues(text, ABSENT), "check-absent")
    assert (issue.what.args["numbers"], issue.what.args["values"]) == ("1", 20)
    profile = understand(read_document(text, "x.toml", lambda name: None))
    decoder = BatteryDecoder(profile.battery, profile.source, parse_definitions(STATES_DBC.encode(), "x.dbc"))
    assert np.isnan(decoder.decode(frames_of(ABSENT))["temperature"].value).all()


@pytest.mark.parametrize(
    ("scale", "period_s", "expected"),
    [("(1,-40)", 0.1, []), ("(1,-40)", 20.0, ["1"]), ("(0.1,0)", 0.1, []), ("(0.1,0)", 3.0, ["1"])],
)
def test_a_temperature_that_never_moves_is_a_finding_once_it_would_have(scale, period_s, expected):
    dbc = STATES_DBC.replace("T1 : 32|8@1+ (1,-40)", f"T1 : 32|8@1+ {scale}")
    text = battery(2, 1) + VOLTAGES + HEATS + READINGS
    found = of_code(issues(text, received(n=40, period_s=period_s), dbc), "check-never-moves")
    assert [issue.what.args["numbers"] for issue in found] == expected


def test_the_gravest_finding_is_the_first():
    frames = [(t, i, (60000).to_bytes(2, "little") + data[2:] if i == 2 else data) for t, i, data in received(pack=78)]
    dbc = STATES_DBC.replace("0|16@1- (0.1,0)", "0|16@1+ (0.1,0)")
    found = issues(battery(3) + VOLTAGES + READINGS, frames, dbc)
    assert next(issue.what.code for issue in found) == "check-unsigned-current"


def test_frames_with_a_wrong_checksum_are_counted():
    peer = cell_number()
    frames = [(t, i, data[:7] + bytes([data[7] ^ 1]) if i == 0x036 else data) for t, i, data in peer.frames(7.2)]
    text = battery(72, 12) + peer.profile + READINGS.replace("Pack_V", "Pack_Inst_V")
    (issue,) = of_code(issues(text, frames, peer.dbc()), "check-bad-checksums")
    assert issue.what.args["n"] == sum(can_id == 0x036 for _, can_id, _ in frames)


@pytest.mark.parametrize(
    ("cells", "of_dbc", "numbers", "n"),
    [(8, range(1, 3), "3-8", 6), (40, range(1, 41, 2), "2, 4, 6, 8, 10, 12, 14, 16, ...", 20)],
)
def test_the_cells_without_a_signal_are_listed_as_people_count_and_many_of_them_shortened(cells, of_dbc, numbers, n):
    lines = "".join(f' SG_ V{k} : {8 * (k // 2)}|8@1+ (0.02,0) [0|5] "V" X\n' for k in of_dbc)
    found = issues(battery(cells) + VOLTAGES, None, HEAD + "BO_ 1 Cells: 64 BMS\n" + lines)
    (issue,) = of_code(found, "check-without-signal")
    assert (issue.what.args["numbers"], issue.what.args["n"]) == (numbers, n)


def test_every_doubt_can_be_said_in_both_languages():
    found = issues(
        battery(9, 2, NOTHING) + VOLTAGES + VOLTAGES + READINGS + SOC.replace("Pack.", ""), received(pack=200)
    )
    assert len(found) >= 5
    for language in ("en", "nb"):
        assert all("{" not in render(issue.what, language=language) for issue in found)
