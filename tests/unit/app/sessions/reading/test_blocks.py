import sqlite3
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from app.sessions.errors import NotASession
from app.sessions.reading.blocks import Block, BlockReader
from app.sessions.recording.recorder import Recorder
from app.sessions.storage.queries import StoredSession
from app.sessions.storage.streams import unpack_streams
from app.sources.loaded_battery import team_battery
from firmware_protocol.memory_map import CONFIG_SIZE, FIELDS

MONO_US = 5_000 * 10**6
ALWAYS_US = 1 << 50
ALL_CELLS = np.arange(96)


def read(path: Path, wanted: dict[str, list[int]], first_us: int = -ALWAYS_US, last_us: int = ALWAYS_US) -> list[Block]:
    stored = StoredSession(path)
    try:
        elements = {name: np.array(each) for name, each in wanted.items()}
        blocks = list(BlockReader(stored, team_battery(), None).blocks(elements, first_us, last_us))
        for block in blocks:
            assert [column.counts.shape[1] for column in block.columns] == [len(c.elements) for c in block.columns]
        return blocks
    finally:
        stored.close()


@pytest.fixture
def path(recorder: Recorder, stream) -> Path:
    """170 s at 10 Hz: two stored chunks and what came after them."""
    info = recorder.start()
    for _ in range(17):
        stream.feed(recorder, 100)
        recorder.flush()
    return info.path


def test_every_sample_is_in_one_block(path: Path, stream) -> None:
    blocks = read(path, {"v": [2, 36]})
    assert len(blocks) == 3
    counts = np.concatenate([block.columns[0].counts for block in blocks])
    np.testing.assert_array_equal(counts, [[each[2], each[36]] for each in stream.voltages])
    times_us = np.concatenate([block.columns[0].track.times_us for block in blocks])
    np.testing.assert_array_equal(times_us, MONO_US + np.arange(1700) * 100_000)


def test_a_block_tells_its_first_and_last_time(path: Path) -> None:
    spans = [(block.first_us, block.last_us) for block in read(path, {"v": [0], "estimate.soc": [0]})]
    assert spans[0][0] == MONO_US
    assert spans[-1][1] == MONO_US + 169_900_000
    # a chunk may end between a sample and its estimate, which then begins the next one
    assert all(after[0] - before[1] in (0, 100_000) for before, after in pairwise(spans))


def test_what_was_sampled_together_shares_its_times(path: Path) -> None:
    for block in read(path, {"v": [0], "i_fs": [0], "t": [5]}):
        first, *others = block.columns
        assert len(others) == 2
        assert all(column.track is first.track for column in others)


def test_a_range_is_cut_with_both_its_ends(path: Path) -> None:
    blocks = read(path, {"v": [0], "i_fs": [0]}, MONO_US + 59_900_000, MONO_US + 120_000_000)
    times_us = np.concatenate([block.columns[0].track.times_us for block in blocks])
    assert (times_us[0], times_us[-1], len(times_us)) == (MONO_US + 59_900_000, MONO_US + 120_000_000, 602)
    assert all(len(c.counts) == len(c.track.times_us) for block in blocks for c in block.columns)
    assert read(path, {"v": [0]}, MONO_US - 10, MONO_US - 1) == []


def test_a_column_is_decoded_only_when_it_is_asked_for(path: Path, monkeypatch) -> None:
    decoded = []

    def counting(streams, dtype, n_samples):
        decoded.append(dtype)
        return unpack_streams(streams, dtype, n_samples)

    monkeypatch.setattr("app.sessions.reading.blocks.unpack_streams", counting)
    stored = StoredSession(path)
    block = next(BlockReader(stored, team_battery(), None).blocks({"v": ALL_CELLS}, -ALWAYS_US, ALWAYS_US))
    assert decoded == ["<i8", "<i8"]  # sample times and instants
    for _ in range(2):
        assert block.columns[0].counts.shape == (len(block.columns[0].track.times_us), 96)
    assert decoded == ["<i8", "<i8", "<u2"]
    stored.close()


def test_frames_with_parts_of_a_field_give_columns_of_these_parts(recorder: Recorder, stream) -> None:
    info = recorder.start()
    for windows in (((1896, 101),), ((1996, 92), (1884, 12))):
        recorder.frame(*stream.next()[:2], 0, stream.next(windows)[2], True)
    recorder.close()
    (block,) = read(info.path, {"v": [0, 49, 50, 95]})
    assert [column.elements.tolist() for column in block.columns] == [[0, 49], [50, 95]]


def test_a_clock_that_went_back_is_put_in_order(recorder: Recorder, stream) -> None:
    info = recorder.start()
    frames = [stream.next() for _ in range(3)]
    for i in (0, 2, 1):
        recorder.frame(*frames[i][:2], 0, frames[i][2], True)
    recorder.close()
    ((column,),) = (block.columns for block in read(info.path, {"v": [36]}))
    assert (np.diff(column.track.times_us) > 0).all()
    assert column.counts[:, 0].tolist() == [each[36] for each in stream.voltages]


@pytest.mark.parametrize("is_sampled", [False, True])
def test_a_configuration_that_is_not_sampled_comes_from_the_images(
    recorder: Recorder, stream, is_sampled: bool
) -> None:
    info = recorder.start()
    image = bytearray(CONFIG_SIZE)
    FIELDS["conf.ts"].pack_into(image, (50,))
    recorder.config(5_000 * 10**9, 0, bytes(image), "read")
    stream.feed(recorder, 3)
    if is_sampled:
        t_mono_ns, t_wall_ns, raw = stream.next(((0, 420),))
        recorder.frame(t_mono_ns, t_wall_ns, 0, raw, True)
    recorder.close()
    (block,) = read(info.path, {"conf.ts": [0]})
    assert block.columns[0].counts[:, 0].tolist() == ([0] if is_sampled else [50, 50])


def test_a_block_that_is_damaged_is_no_session(path: Path, recorder: Recorder) -> None:
    recorder.close()
    connection = sqlite3.connect(path)
    connection.execute("UPDATE columns SET data = substr(data, 1, 7)")
    connection.commit()
    connection.close()
    with pytest.raises(NotASession, match="damaged"):
        read(path, {"v": [36]})
