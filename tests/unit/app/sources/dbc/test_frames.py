import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from app.sources.dbc.frames import frames_of, frames_of_items
from app.sources.items import CanItem

FRAMES = st.lists(
    st.tuples(st.integers(0, 2**62), st.integers(0, 0x1FFFFFFF).map(lambda i: i | 0x80000000), st.binary(max_size=64)),
    max_size=20,
)


@given(FRAMES)
def test_columns_hold_every_byte_of_every_frame_and_zeros_behind(rows):
    frames = frames_of(iter(rows))
    assert len(frames) == len(rows)
    assert frames.data.shape[1] == (64 if any(len(data) > 8 for _, _, data in rows) else 8)
    for i, (t_ns, can_id, data) in enumerate(rows):
        assert (int(frames.t_ns[i]), int(frames.can_id[i]), int(frames.length[i])) == (t_ns, can_id, len(data))
        assert frames.data[i].tobytes() == data.ljust(frames.data.shape[1], b"\0")


def test_a_part_of_the_frames_keeps_their_order():
    frames = frames_of([(k, 0x100 + k, bytes([k])) for k in range(6)])
    part = frames.part(np.array([4, 1]))
    assert part.t_ns.tolist() == [4, 1]
    assert part.data[:, 0].tolist() == [4, 1]
    assert frames.part(slice(2, 4)).can_id.tolist() == [0x102, 0x103]


def test_what_a_link_delivers_has_the_time_of_the_monotonic_clock():
    item = CanItem(t_mono_ns=5_000, t_wall_ns=1_700_000_000_000_000_000, can_id=0x123, data=b"\x01\x02")
    frames = frames_of_items([item])
    assert (frames.t_ns.tolist(), frames.length.tolist()) == ([5_000], [2])


def test_no_frames_are_columns_without_rows():
    frames = frames_of([])
    assert (len(frames), frames.data.shape) == (0, (0, 8))
    assert len(frames.part(slice(0, 5))) == 0
