import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.sessions.storage.chunks import ChunkBuilder, encode_estimate
from firmware_protocol.framing import encode_frame
from firmware_protocol.memory_map import FIELDS, MASTER_SIZE
from firmware_protocol.messages import Data, MessageType, Reply, Window
from tests.campaign import examples

SPAN = st.tuples(st.integers(0, MASTER_SIZE - 1), st.integers(0, 150)).map(
    lambda span: (span[0], min(span[1], MASTER_SIZE - span[0]))
)


def frame(uptime_ms: int, body: bytes, kind: int = MessageType.DATA) -> bytes:
    return encode_frame(kind, 0, uptime_ms, body)[1:-1]


@settings(max_examples=examples(50), deadline=None)
@given(st.lists(st.lists(SPAN, min_size=1, max_size=3), min_size=1, max_size=6), st.integers(0, 2**32))
def test_columns_hold_exactly_the_whole_elements_that_were_sent(layouts, seed: int) -> None:
    """Against a decoder written out: an element counts where all its bytes lie in one window."""
    builder, expected, rng = ChunkBuilder(), {}, np.random.default_rng(seed)
    for i, spans in enumerate(layouts):
        image = rng.bytes(MASTER_SIZE)
        taken = dict.fromkeys(spans)
        builder.add_frame(i * 1000, frame(i, Data(tuple(Window(o, image[o : o + n]) for o, n in taken)).to_body()))
        for field in FIELDS.values():
            for element, value in enumerate(field.unpack(image)):
                start = field.offset + element * field.item_size
                if any(o <= start and start + field.item_size <= o + n for o, n in taken):
                    expected.setdefault((field.name, element), set()).add((i, value))
    chunk = builder.build()
    found: dict[tuple[str, int], set[tuple[int, int]]] = {}
    for key, (number, values) in chunk.columns.items():
        times_us = chunk.tracks[number].times_us
        for i in range(key.elements):
            samples = zip(times_us.tolist(), values[:, i].tolist(), strict=True)
            found.setdefault((key.field, key.first_element + i), set()).update(samples)
    assert found == expected


def test_other_frames_and_noise_give_no_sample() -> None:
    builder = ChunkBuilder()
    builder.add_frame(1, frame(5, Reply(1, 1, 0).to_body(), MessageType.REPLY))
    builder.add_frame(2, frame(6, b"\1"))
    builder.add_frame(3, b"noise")
    assert builder.build().columns == {}
    assert builder.build().span_us == (0, -1)
    assert builder.master_clock == (0, 6)


def test_an_estimate_made_before_a_boot_keeps_its_instant() -> None:
    builder = ChunkBuilder()
    body = Data((Window(2982, b"\0\0"),)).to_body()
    builder.add_frame(1_000_000, frame(90_000, body))
    builder.add_frame(2_000_000, frame(10, body))
    builder.add_estimate(2_100_000, 90_000, bytes(192), bytes(192))
    builder.add_estimate(2_200_000, 10, bytes(192), bytes(192))
    chunk = builder.build()
    of_frames, of_estimates = (track.instants.tolist() for track in chunk.tracks)
    assert of_frames == of_estimates == [90_000, (1 << 32) + 10]


def test_estimates_are_stored_to_two_hundred_thousandths_and_missing_ones_as_missing() -> None:
    values = np.array([0.0, 1.0, 0.12345, -0.2, 1.5, np.nan, np.inf])
    counts = np.frombuffer(encode_estimate(values), "<u2")
    assert counts[:5] * 2e-5 == pytest.approx([0, 1, 0.12345, 0, 65534 * 2e-5], abs=1e-5)
    assert list(counts[5:]) == [65535, 65535]
