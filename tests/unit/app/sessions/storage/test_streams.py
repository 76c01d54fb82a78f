import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from app.sessions.storage.streams import pack_block, stream_ranges, unpack_streams

DTYPES = ["|i1", "|u1", "<i2", "<u2", "<i4", "<u4", "<i8"]


@given(st.data())
def test_any_block_comes_back_element_by_element(data: st.DataObject) -> None:
    dtype = data.draw(st.sampled_from(DTYPES))
    values = data.draw(hnp.arrays(dtype, st.tuples(st.integers(1, 20), st.integers(1, 4))))
    ends, packed = pack_block(values)
    elements = data.draw(st.lists(st.integers(0, values.shape[1] - 1), min_size=1, unique=True))
    streams = [packed[start:end] for start, end in stream_ranges(ends, np.array(elements))]
    assert np.array_equal(unpack_streams(streams, dtype, len(values)), values[:, elements])


def test_a_constant_costs_one_item_and_noise_less_than_itself() -> None:
    constant = np.full((1000, 1), 41234, "<u2")
    assert len(pack_block(constant)[1]) == 2
    noise = (36000 + np.random.default_rng(1).integers(-5, 6, (1000, 1))).astype("<u2")
    assert len(pack_block(noise)[1]) < 1000


def test_a_damaged_stream_is_an_error() -> None:
    _, packed = pack_block(np.arange(100, dtype="<u2")[:, None] ** 2)
    with pytest.raises(ValueError, match="other than 198 bytes"):
        unpack_streams([packed], "<u2", 99)
