"""Our extraction against cantools' own decoding: any signals, any frames."""

import cantools
import numpy as np
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.decoder import decode_frames
from app.sources.dbc.frames import frames_of
from tests.campaign import examples

LENGTHS = [1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64]
HEAD = 'VERSION ""\nNS_ :\nBS_:\nBU_: BMS\n'


@st.composite
def places(draw, length, bits=None):
    """A start, length and byte order that fit into `length` bytes."""
    size = bits or draw(st.integers(1, min(64, 8 * length)))
    first = draw(st.integers(0, 8 * length - size))  # counted from the first bit on the wire
    if draw(st.booleans()):
        return first, size, 1
    return first // 8 * 8 + 7 - first % 8, size, 0


@st.composite
def signals(draw, name, length, mux=""):
    kind = draw(st.sampled_from(["+", "-", "float"]))
    bits = None
    if kind == "float":
        bits = draw(st.sampled_from([each for each in (32, 64) if each <= 8 * length] or [0])) or None
    start, size, order = draw(places(length, bits))
    factor = draw(st.sampled_from(["1", "0.001", "0.0001", "0.01", "-0.1", "0.0048828125", "2"]))
    offset = draw(st.sampled_from(["0", "2", "-40", "-3200.5"]))
    sign = "-" if kind == "float" else kind
    line = f' SG_ {name} {mux}: {start}|{size}@{order}{sign} ({factor},{offset}) [0|0] "V" Vector__XXX'
    return line, bits if kind == "float" else None


@st.composite
def databases(draw):
    lines, floats = [HEAD], []
    for m in range(draw(st.integers(1, 3))):
        can_id = 0x100 + m if draw(st.booleans()) else 0x80000000 | (0x18FF0000 + m)
        length = draw(st.sampled_from(LENGTHS))
        lines.append(f"BO_ {can_id} M{m}: {length} BMS")
        shape = draw(st.sampled_from(["plain", "mux", "nested"]))
        muxes = {"plain": [""], "mux": ["m0 ", "m1 ", "m3 ", ""], "nested": ["m0 ", "m2 ", "nested ", ""]}[shape]
        if shape != "plain":
            lines.append(' SG_ Mux M : 0|2@1+ (1,0) [0|0] "" Vector__XXX')
        if shape == "nested":
            lines.append(' SG_ Inner m1M : 2|2@1+ (1,0) [0|0] "" Vector__XXX')
        for s in range(draw(st.integers(1, 5))):
            mux = draw(st.sampled_from(muxes))
            value = draw(st.integers(0, 3))
            line, bits = draw(signals(f"S{s}", length, f"m{value} " if mux == "nested " else mux))
            lines.append(line)
            if bits:
                floats.append(f"SIG_VALTYPE_ {can_id} S{s} : {1 if bits == 32 else 2};")
            if mux == "nested ":
                floats.append(f"SG_MUL_VAL_ {can_id} S{s} Inner {value}-{value};")
            elif mux and shape == "nested":
                floats.append(f"SG_MUL_VAL_ {can_id} S{s} Mux {mux.strip()[1:]}-{mux.strip()[1:]};")
        if shape == "nested":
            floats.append(f"SG_MUL_VAL_ {can_id} Inner Mux 1-1;")
    return "\n".join([*lines, "", *floats, ""])


@settings(max_examples=examples(40), deadline=None, phases=[Phase.generate], suppress_health_check=list(HealthCheck))
@given(st.data())
def test_every_signal_of_every_frame_is_what_cantools_decodes(data):
    text = data.draw(databases())
    ours = parse_definitions(text.encode(), "any.dbc")
    theirs = cantools.database.load_string(text, database_format="dbc", strict=False)
    frames = []
    for t in range(data.draw(st.integers(1, 8))):
        message = data.draw(st.sampled_from(ours.messages))
        frames.append((t, message.can_id, data.draw(st.binary(min_size=message.length, max_size=message.length))))
    found = decode_frames(frames_of(frames), ours)
    expected = {}
    for t, can_id, raw in frames:
        message = theirs.get_message_by_frame_id(can_id & 0x7FFFFFFF)
        try:
            values = message.decode(raw, decode_choices=False)
        except cantools.database.DecodeError:  # a multiplexer's value that no signal has: it refuses the whole frame
            continue
        for name, value in values.items():
            expected.setdefault((message.name, name), []).append((t, value))
    for key, pairs in expected.items():
        at = dict(zip(found[key].t_ns.tolist(), found[key].values.tolist(), strict=True))
        np.testing.assert_allclose([at[t] for t, _ in pairs], [v for _, v in pairs], rtol=1e-12, atol=1e-12)


@given(st.binary(max_size=7))
def test_a_signal_beyond_a_short_frame_is_missing(raw):
    text = HEAD + 'BO_ 256 M: 8 BMS\n SG_ A : 0|8@1+ (1,0) [0|0] "" X\n SG_ B : 55|16@0+ (1,0) [0|0] "" X\n'
    found = decode_frames(frames_of([(0, 256, raw)]), parse_definitions(text.encode(), "any.dbc"))
    assert ("M", "B") not in found
    assert (("M", "A") in found) == (len(raw) > 0)
