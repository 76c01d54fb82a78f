import math

import numpy as np
import pytest

from app.battery.profile import read_document, understand
from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.encoder import FrameEncoder

HEAD = 'VERSION ""\nNS_ :\nBS_:\nBU_: B\n'
CYCLE = 'BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;\nBA_DEF_DEF_ "GenMsgCycleTime" 0;\n'
ONE = 'BO_ 1 M: 8 B\n SG_ U0 : 0|16@1+ (0.001,0) [0|0] "V" B\n SG_ U1 : 16|16@1+ (0.001,0) [0|0] "V" B\n'
CELLS = '[[source.voltage]]\nsignal = "U{cell}"\n'


def speech(messages, profile, segments=(2,), more=""):
    text = f'[battery]\nname = "x"\nsegments = {list(segments)}\n[source]\ndbc = "x.dbc"\n{profile}'
    understood = understand(read_document(text, "x.toml", lambda name: None))
    return FrameEncoder(
        understood.battery, understood.source, parse_definitions((HEAD + messages + more).encode(), "x.dbc")
    )


def first(of, **readings):
    """The first frame with such readings."""
    values = {kind.replace("__", "."): np.atleast_1d(np.array(value, float)) for kind, value in readings.items()}
    return of.frames(of.due_s, values)


def numbers(data):
    return np.frombuffer(data, "<u2").tolist()


def test_a_message_comes_at_its_cycle_time_and_else_every_tenth_of_a_second():
    for more, expected_s in (("", 0.1), (CYCLE + 'BA_ "GenMsgCycleTime" BO_ 1 250;\n', 0.25)):
        of = speech(ONE, CELLS, more=more)
        at = [of.due_s]
        for _ in range(4):
            of.frames(of.due_s, {"voltage": np.full(2, 3.7)})
            at.append(of.due_s)
        assert np.diff(at) == pytest.approx(expected_s)


def test_usual_rates_leave_half_a_bus_free():
    messages = "".join(
        f"BO_ {m + 1} M{m}: 8 B\n"
        + "".join(f' SG_ U{4 * m + k} : {16 * k}|16@1+ (1,0) [0|0] "mV" B\n' for k in range(4))
        for m in range(240)
    )
    of = speech(messages, CELLS, segments=(960,))
    n, values = 0, {"voltage": np.full(960, 3.7)}
    while of.due_s < 2.0:
        n += len(of.frames(of.due_s, values))
    assert n / 2.0 * 131 < 255_000
    assert n >= 240


@pytest.mark.parametrize(
    ("profile", "volts", "raw"),
    [
        ("invalid = [65535]\n", [math.nan, 3.7], [65535, 3700]),
        ("valid_range = [1.0, 5.0]\n", [math.nan, 3.7], [5001, 3700]),
        ("", [math.nan, 3.7], [0, 3700]),
        ("invalid = [3700]\n", [3.7, 3.7], [3701, 3701]),  # a value is never told as the code of a missing one
        ("", [math.nan, math.nan], []),
    ],
)
def test_a_missing_cell_is_told_as_the_profile_says_and_not_without_any_other(profile, volts, raw):
    frames = first(speech(ONE, CELLS + profile), voltage=volts)
    assert [number for _, data in frames for number in numbers(data)[:2]] == raw


@pytest.mark.parametrize(("flag", "when_missing"), [("invalid_signal", 1), ("valid_signal", 0)])
def test_a_missing_cell_is_told_by_its_flag(flag, when_missing):
    messages = 'BO_ 1 M: 8 B\n SG_ U0 : 0|16@1+ (1,0) [0|0] "mV" B\n SG_ U1 : 16|16@1+ (1,0) [0|0] "mV" B\n'
    messages += ' SG_ F0 : 32|1@1+ (1,0) [0|0] "" B\n SG_ F1 : 40|1@1+ (1,0) [0|0] "" B\n'
    ((_, data),) = first(speech(messages, CELLS + f'{flag} = "F{{cell}}"\n'), voltage=[math.nan, 3.7])
    assert (data[4], data[5]) == (when_missing, 1 - when_missing)


STATES = (
    '[source.state.closed]\nsignal = "State"\nequals = [3, 4]\n'
    '[source.state.charging]\nsignal = "State"\nequals = [4]\n'
    '[source.state.fault]\nsignal = "State"\nequals = [9]\n[source.state.balancing]\nsignal = "Bits"\nmask = 4\n'
)


@pytest.mark.parametrize(
    ("held", "state", "bits"),
    [((), 0, 0), (("closed",), 3, 0), (("closed", "charging"), 4, 0), (("fault",), 9, 0), (("balancing",), 0, 4)],
)
def test_states_that_share_a_signal_are_told_by_the_number_that_says_them(held, state, bits):
    messages = ONE + 'BO_ 2 S: 2 B\n SG_ State : 0|4@1+ (1,0) [0|0] "" B\n SG_ Bits : 8|8@1+ (1,0) [0|0] "" B\n'
    of = speech(messages, CELLS + STATES)
    names = ("closed", "charging", "fault", "balancing")
    frames = dict(of.frames(1.0, {f"state.{name}": np.array([float(name in held)]) for name in names}))
    assert (frames[2][0] & 0xF, frames[2][1]) == (state, bits)


def test_what_has_no_place_in_the_dbc_is_told():
    of = speech(ONE, CELLS, segments=(4,))
    assert of.not_encoded()["voltage"] == [2, 3]


def test_a_length_that_no_frame_has_is_filled_up_and_marked_as_fd():
    messages = 'BO_ 1 M: 10 B\n SG_ U0 : 64|16@1+ (0.001,0) [0|0] "V" B\n'
    of = speech(messages, CELLS, segments=(1,))
    ((_, data),) = first(of, voltage=[3.7])
    assert len(data) == 12
    assert of.has_fd_frames
    assert not speech(ONE, CELLS).has_fd_frames


def test_a_start_anew_begins_all_rounds_at_their_first_frame():
    messages = 'BO_ 1 M: 8 B\n SG_ N : 0|8@1+ (1,0) [0|0] "" B\n SG_ U : 8|16@1+ (1,0) [0|0] "mV" B\n'
    of = speech(messages, '[[source.voltage]]\nsignal = "U"\nnumbers = {cell = "N"}\n', segments=(5,))
    told = [of.frames(of.due_s, {"voltage": np.full(5, 3.7)})[0][1][0] for _ in range(7)]
    assert told == [0, 1, 2, 3, 4, 0, 1]
    of.begin(100.0)
    assert of.due_s == 100.0
    assert of.frames(100.0, {"voltage": np.full(5, 3.7)})[0][1][0] == 0
