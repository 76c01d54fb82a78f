import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.battery.profile import read_document, understand
from app.sources.dbc import battery_decoder
from app.sources.dbc.assembly import Assembler
from app.sources.dbc.battery_decoder import BatteryDecoder
from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.frames import frames_of
from tests.peer_batteries import PEERS, cell_number, one_signal_a_cell
from tests.peer_messages import HEAD

CURRENT = """
[source.current]
signal = "BMS_PackStatus.Pack_Current"
positive = "discharge"
[source.pack_voltage]
signal = "BMS_PackStatus.Pack_Voltage"
[source.soc]
signal = "BMS_PackStatus.Pack_SOC"
"""


def battery_and_source(text, n_cells, n_sensors, segments=None, more=""):
    head = f'[battery]\nname = "x"\nsegments = {list(segments or (n_cells,))}\n'
    head += f"[battery.temperatures]\nsensors = {n_sensors}\n"
    profile = understand(read_document(f'{head}[source]\ndbc = "x.dbc"\n{text}{more}', "x.toml", lambda name: None))
    return profile.battery, profile.source


def decoder_of(peer, more=""):
    battery, source = battery_and_source(peer.profile, peer.n_cells, peer.n_sensors, peer.segments, more)
    return BatteryDecoder(battery, source, parse_definitions(peer.dbc().encode(), "x.dbc"))


@pytest.mark.parametrize("make", PEERS, ids=[make().name for make in PEERS])
def test_batches_of_any_size_give_what_one_gives(make):
    peer = make()
    frames = frames_of(peer.frames(2))
    whole = decoder_of(peer).decode(frames)["voltage"]
    decoder = decoder_of(peer)
    parts = [decoder.decode(frames.part(slice(i, i + 37))).get("voltage") for i in range(0, len(frames), 37)]
    np.testing.assert_array_equal(np.concatenate([part.value for part in parts if part]), whole.value)
    np.testing.assert_array_equal(np.concatenate([part.index for part in parts if part]), whole.index)


def test_a_frame_with_a_wrong_checksum_tells_nothing():
    peer = cell_number()
    decoder = decoder_of(peer)
    broken = [(t, i, data[:7] + bytes([data[7] ^ 1])) for t, i, data in peer.frames(8) if i == 0x036]
    assert "voltage" not in decoder.decode(frames_of(broken))
    assert decoder.bad_checksums == len(broken)


def test_after_a_pause_of_the_bus_old_values_are_not_live_for_long():
    peer = one_signal_a_cell(8, 0, "V{}", "T{}", 0.0001, "V")
    peer.profile = VOLTAGES
    decoder = decoder_of(peer, CURRENT)
    assembler = Assembler(decoder.battery, decoder.source)
    first = peer.frames(3)
    again = [(t + 63_000_000_000, can_id, data) for t, can_id, data in peer.frames(1)]
    for part in (first, again):
        assembler.feed(decoder.decode(frames_of(part)))
    later = assembler.feed({}, again[-1][0] + 5_000_000_000)
    assert np.isnan(later[-1].voltage_v).all()
    assert np.isnan(later[-1].current_a)


SIGNALS = """BO_ 1 M: 8 BMS
 SG_ V1 : 0|16@1+ (0.001,0) [0|0] "V" X
 SG_ V2 : 16|16@1+ (0.001,0) [0|0] "V" X
 SG_ Good1 : 32|1@1+ (1,0) [0|1] "" X
 SG_ Good2 : 33|1@1+ (1,0) [0|1] "" X
 SG_ State : 40|8@1+ (1,0) [0|0] "" X
 SG_ I : 48|16@1- (0.1,0) [0|0] "A" X
"""
NAN = float("nan")
VOLTAGES = '[[source.voltage]]\nsignal = "V{cell}"\nbase = 1\n'


def decoded(text, *frames, dbc=SIGNALS, n_cells=2, n_sensors=0, segments=None):
    battery, source = battery_and_source(text, n_cells, n_sensors, segments)
    decoder = BatteryDecoder(battery, source, parse_definitions((HEAD + dbc).encode(), "x.dbc"))
    return decoder, decoder.decode(frames_of([(k, can_id, data) for k, (can_id, data) in enumerate(frames)]))


def frame(one=3700, two=3710, flags=0, state=0, current=0):
    raw = one | two << 16 | flags << 32 | state << 40 | (current & 0xFFFF) << 48
    return 1, raw.to_bytes(8, "little")


@given(st.lists(st.tuples(st.integers(0, 65535), st.integers(0, 65535)), min_size=1, max_size=20))
def test_every_value_of_every_frame_comes_once_with_its_cell_and_time(volts):
    _, found = decoded(VOLTAGES, *(frame(one, two) for one, two in volts))
    values = found["voltage"]
    assert list(zip(values.t_ns.tolist(), values.index.tolist(), strict=True)) == [
        (k, cell) for k in range(len(volts)) for cell in (0, 1)
    ]
    np.testing.assert_allclose(values.value, [volt / 1000 for pair in volts for volt in pair])


@pytest.mark.parametrize(
    ("more", "frames", "kind", "expected"),
    [
        ('valid_signal = "Good{cell}"\n', [frame(flags=1), frame(flags=2)], "voltage", [3.7, NAN, NAN, 3.71]),
        (
            'invalid = [0, 65535]\ninvalid_signal = "Good{cell}"\nvalid_range = [0.5, 5.0]\n',
            [frame(), frame(one=0), frame(one=65535), frame(flags=1), frame(one=9000)],
            "voltage",
            [3.7, 3.71, NAN, 3.71, NAN, 3.71, NAN, 3.71, NAN, 3.71],
        ),
        # after the unit
        ('unit = "mV"\nscale = 2.0\noffset = 0.5\n', [frame()], "voltage", [0.0037 * 2 + 0.5, 0.00371 * 2 + 0.5]),
        # positive on discharge, whatever the bus says
        ('[source.current]\nsignal = "I"\npositive = "discharge"\nzero = 0.5\n', [frame(current=125)], "current", [12]),
        ('[source.current]\nsignal = "I"\npositive = "charge"\nzero = 0.5\n', [frame(current=125)], "current", [-12]),
    ],
)
def test_a_value_is_what_the_profile_makes_of_it_or_missing(more, frames, kind, expected):
    _, found = decoded(VOLTAGES + more, *frames)
    np.testing.assert_allclose(found[kind].value, expected)


PAGES = """BO_ 1 M: 8 BMS
 SG_ Page M : 0|8@1+ (1,0) [0|3] "" X
 SG_ V0 m0 : 8|16@1+ (0.001,0) [0|5] "V" X
 SG_ V1 m1 : 8|16@1+ (0.001,0) [0|5] "V" X
 SG_ V2 m5 : 8|16@1+ (0.001,0) [0|5] "V" X
"""


@given(st.lists(st.integers(0, 255), min_size=1, max_size=30))
def test_a_page_that_no_cell_stands_on_tells_nothing(pages):
    frames = [(1, bytes([page]) + (3000 + page).to_bytes(2, "little")) for page in pages]
    _, found = decoded('[[source.voltage]]\nsignal = "V{cell}"\n', *frames, dbc=PAGES, n_cells=3)
    cell_of = {0: 0, 1: 1, 5: 2}
    expected = [(k, cell_of[page], 3.0 + page / 1000) for k, page in enumerate(pages) if page in cell_of]
    values = found.get("voltage")
    got = [] if values is None else list(zip(values.t_ns.tolist(), values.index.tolist(), values.value, strict=True))
    assert [row[:2] for row in got] == [row[:2] for row in expected]
    np.testing.assert_allclose([row[2] for row in got], [row[2] for row in expected])


NUMBERED = """BO_ 1 M: 8 BMS
 SG_ Module : 7|8@0+ (1,0) [0|0] "" X
 SG_ Cell : 15|8@0+ (1,0) [0|0] "" X
 SG_ U : 23|16@0+ (0.1,0) [0|0] "mV" X
"""


@given(
    st.lists(st.tuples(st.integers(0, 5), st.integers(0, 9)), min_size=1, max_size=30),
    st.integers(0, 1),
    st.lists(st.integers(1, 8), min_size=1, max_size=4),
)
def test_module_and_cell_of_the_frame_tell_the_cell_and_others_are_counted(told, base, segments):
    text = '[[source.voltage]]\nsignal = "U"\nnumbers = { segment = "Module", cell = "Cell" }\n'
    text += f"base = {{ segment = {base}, cell = {base} }}\n"
    frames = [(1, bytes([module, cell]) + (37000 + module * 10 + cell).to_bytes(2, "big")) for module, cell in told]
    decoder, found = decoded(text, *frames, dbc=NUMBERED, n_cells=sum(segments), segments=segments)
    expected = [
        (sum(segments[: module - base]) + cell - base, (37000 + module * 10 + cell) / 1e4)
        for module, cell in told
        if 0 <= module - base < len(segments) and 0 <= cell - base < segments[module - base]
    ]
    values = found.get("voltage")
    got = [] if values is None else list(zip(values.index.tolist(), values.value.tolist(), strict=True))
    assert [cell for cell, _ in got] == [cell for cell, _ in expected]
    np.testing.assert_allclose([volt for _, volt in got], [volt for _, volt in expected])
    assert decoder.beyond["M.U"] == len(told) - len(expected)


def test_the_same_cell_of_two_ways_comes_from_both_in_the_order_of_time():
    twin = SIGNALS + '\nBO_ 2 N: 2 BMS\n SG_ W1 : 0|16@1+ (0.001,0) [0|0] "V" X\n'
    text = VOLTAGES + '[[source.voltage]]\nsignal = "W{cell}"\nbase = 1\n'
    _, found = decoded(text, frame(), (2, b"\x74\x0e"), frame(), dbc=twin)
    assert found["voltage"].t_ns.tolist() == [0, 0, 1, 2, 2]
    assert found["voltage"].index.tolist() == [0, 1, 0, 0, 1]


# one pass over many messages gives what lane by lane gives


def equal(one, other):
    assert one.keys() == other.keys()
    for kind in one:
        np.testing.assert_array_equal(one[kind].t_ns, other[kind].t_ns)
        np.testing.assert_array_equal(one[kind].index, other[kind].index)
        np.testing.assert_array_equal(one[kind].value, other[kind].value)


def both_ways(decoder, frames, monkeypatch):
    quick = decoder.decode(frames)
    with monkeypatch.context() as patch:
        patch.setattr(battery_decoder, "MANY_FRAMES", 0)
        equal(quick, decoder.decode(frames))
    return quick


@pytest.mark.parametrize("make", PEERS, ids=[make().name for make in PEERS])
def test_every_way_to_address_cells_decodes_alike_in_small_batches(make, monkeypatch):
    peer = make()
    frames = frames_of(peer.frames(1))
    assert "voltage" in both_ways(decoder_of(peer), frames.part(slice(0, 300)), monkeypatch)


RANGED = """[[source.voltage]]
signal = "V{cell}"
base = 1
invalid = [0, 7]
valid_range = [-50, 50]
"""


@st.composite
def layouts(draw):
    """A number of any length at any place of a frame of 8 or 64 bytes, in either byte order."""
    size = draw(st.sampled_from([8, 64]))
    length = draw(st.integers(1, 56))
    begin = draw(st.integers(0, 8 * size - length))
    is_little = draw(st.booleans())
    start = begin if is_little else begin // 8 * 8 + 7 - begin % 8
    sign = draw(st.sampled_from("+-"))
    scale, offset = draw(st.sampled_from([(1, 0), (0.001, 0), (0.5, -40), (-2, 3)]))
    return size, f"{start}|{length}@{int(is_little)}{sign} ({scale},{offset})"


@given(st.lists(layouts(), min_size=1, max_size=6), st.data())
def test_any_layout_of_any_frame_decodes_alike(found, data):
    text = HEAD + "".join(
        f'BO_ {100 + k} M{k}: {size} BMS\n SG_ V{k + 1} : {layout} [0|0] "V" X\n\n'
        for k, (size, layout) in enumerate(found)
    )
    battery, source = battery_and_source(RANGED, len(found), 0, (len(found),))
    decoder = BatteryDecoder(battery, source, parse_definitions(text.encode(), "x.dbc"))
    frames = []
    for t in range(data.draw(st.integers(1, 12))):
        k = data.draw(st.integers(0, len(found)))  # one id more than there are messages
        size = found[k][0] if k < len(found) else 8
        frames.append((t, 100 + k, data.draw(st.binary(max_size=size))))
    with pytest.MonkeyPatch.context() as patch:
        both_ways(decoder, frames_of(frames), patch)


def test_a_current_beside_the_cells_is_in_the_same_pass(monkeypatch):
    peer = PEERS[0]()
    found = both_ways(decoder_of(peer, CURRENT), frames_of(peer.frames(1)), monkeypatch)
    assert {"voltage", "temperature", "current", "pack_voltage", "soc"} <= found.keys()
