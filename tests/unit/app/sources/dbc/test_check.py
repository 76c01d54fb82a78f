import pytest

from app.battery.profile import read_document, understand
from app.sources.dbc.check import doubts_of
from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.frames import frames_of
from tests.peer_batteries import HEAD, cell_number, one_signal_a_cell

VOLTAGES = '[[source.voltage]]\nsignal = "V{cell}"\nbase = 1\n'
HOT = "[battery.limits]\ntemperature_max_degc = 70\n[battery.rules]\ntemperature_max_degc = 60\n"
FULL = "[battery.limits]\ncell_voltage_max_v = 4.2\n[battery.rules]\nsegment_voltage_max_v = 30\n"
NOTHING = "cells = [[1, 2, 3, 4, 5, 6, 7, 8], []]\n"
READINGS = '[source.current]\nsignal = "Pack_Current"\n[source.pack_voltage]\nsignal = "Pack_Voltage"\n'


def found(profile, dbc, frames=None):
    profile = understand(read_document(profile, "x.toml", lambda name: None))
    definitions = parse_definitions(dbc.encode(), "x.dbc")
    doubts = doubts_of(
        profile.battery, profile.source, definitions, "x.toml", None if frames is None else frames_of(frames)
    )
    return {(doubt.what.code, doubt.is_error) for doubt in doubts}


def battery(cells, sensors=0, more=""):
    head = f'[battery]\nname = "x"\nsegments = [{cells}]\n[battery.temperatures]\nsensors = {sensors}\n'
    return head + more + '[source]\ndbc = "x.dbc"\n'


@pytest.fixture
def peer():
    return one_signal_a_cell(8, 0, "V{}", "T{}", 0.0001, "V")


def test_a_sound_profile_has_no_doubts(peer):
    assert found(battery(8) + VOLTAGES + READINGS, peer.dbc(), peer.frames(2)) == set()


@pytest.mark.parametrize(
    ("profile", "code", "is_error"),
    [
        (battery(9) + VOLTAGES + READINGS, "check-without-signal", False),
        (battery(7) + VOLTAGES + READINGS, "cell-beyond", False),
        (battery(8) + VOLTAGES.replace("V{", "U{") + READINGS, "no-signal-fits", True),
        (battery(8) + VOLTAGES + 'invalid_signal = "Bad{cell}"\n' + READINGS, "signal-not-in-dbc", True),
        (battery(8) + VOLTAGES.replace("{cell}", "{zell}") + READINGS, "no-such-placeholder", True),
        (battery(8) + VOLTAGES + VOLTAGES + READINGS, "check-two-signals", False),
        (battery(8) + VOLTAGES, "check-no-current", False),
        (battery(8) + READINGS, "check-no-voltages", False),
        (battery(8) + VOLTAGES + READINGS.replace("Pack_C", "Sack_C"), "signal-not-in-dbc", True),
        (battery(8, 1, "cells = [[1, 2]]\n") + VOLTAGES + READINGS, "check-no-sensor", False),
        (battery(8, 2, NOTHING) + VOLTAGES + READINGS, "check-sensor-of-nothing", False),
        (battery(8, 0, HOT) + VOLTAGES + READINGS, "check-beyond-rule", False),
        (battery(8, 0, FULL) + VOLTAGES + READINGS, "check-cells-beyond-rule", False),
    ],
)  # fmt: skip
def test_doubts_of_a_profile_without_a_log(peer, profile, code, is_error):
    assert (code, is_error) in found(profile, peer.dbc())


def test_cells_that_are_silent_in_a_log_are_told(peer):
    frames = [frame for frame in peer.frames(2) if frame[1] != 0x201]
    assert ("check-cells-never-heard", False) in found(battery(8) + VOLTAGES + READINGS, peer.dbc(), frames)


def test_a_sum_that_is_not_the_pack_voltage_is_told(peer):
    dbc = peer.dbc().replace(" SG_ Pack_Voltage : 0|16@1+ (0.1,0)", " SG_ Pack_Voltage : 0|16@1+ (0.2,0)")
    assert ("check-sum-off", False) in found(battery(8) + VOLTAGES + READINGS, dbc, peer.frames(2))


def test_a_wrong_unit_and_an_age_that_is_too_short_are_told(peer):
    codes = found(battery(8) + VOLTAGES + 'unit = "mV"\nmax_age_s = 0.05\n' + READINGS, peer.dbc(), peer.frames(2))
    assert {("check-implausible", False), ("check-age-too-short", False)} <= codes


def test_cells_that_come_slower_than_the_filter_can_bridge_are_told():
    peer = cell_number()
    slow = [(8 * t, i, data) for t, i, data in peer.frames(16)]
    text = battery(70, 12) + peer.profile + READINGS.replace("Pack_V", "Pack_Inst_V")
    codes = found(text, peer.dbc(), slow)
    assert {("check-slow", False), ("check-numbers-beyond", False)} <= codes


def test_an_empty_log_and_a_log_of_another_car_are_told(peer):
    assert ("check-empty-log", False) in found(battery(8) + VOLTAGES + READINGS, peer.dbc(), [])
    other = found(battery(8) + VOLTAGES + READINGS, peer.dbc(), [(0, 0x7F0, b"\0")])
    assert {("check-nothing-of-it", False), ("check-never-heard", False)} <= other


def test_oddities_of_the_dbc_are_doubts_with_their_line(peer):
    assert ("dbc-of-unknown-message", False) in found(
        battery(8) + VOLTAGES + READINGS, peer.dbc() + 'CM_ BO_ 2000 "far";\n'
    )
    assert HEAD in peer.dbc()
