"""One pass over many messages gives what lane by lane gives."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.sources.dbc import battery_decoder
from app.sources.dbc.battery_decoder import BatteryDecoder
from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.frames import frames_of
from tests.peer_messages import HEAD
from tests.unit.app.sources.dbc.test_battery_decoder import CURRENT, PEERS, battery_and_source


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
    battery, source = battery_and_source(peer.profile, peer.n_cells, peer.n_sensors, peer.segments)
    decoder = BatteryDecoder(battery, source, parse_definitions(peer.dbc().encode(), "x.dbc"))
    frames = frames_of(peer.frames(1))
    assert "voltage" in both_ways(decoder, frames.part(slice(0, 300)), monkeypatch)


PROFILE = """[[source.voltage]]
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
    battery, source = battery_and_source(PROFILE, len(found), 0, (len(found),))
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
    battery, source = battery_and_source(peer.profile, peer.n_cells, peer.n_sensors, peer.segments, CURRENT)
    decoder = BatteryDecoder(battery, source, parse_definitions(peer.dbc().encode(), "x.dbc"))
    found = both_ways(decoder, frames_of(peer.frames(1)), monkeypatch)
    assert {"voltage", "temperature", "current", "pack_voltage", "soc"} <= found.keys()
