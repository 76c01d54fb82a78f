"""Frames beyond what is sorted in memory: they come back by time, and of one time in the order in which they came."""

from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.sessions.transfer import frame_spool
from app.sessions.transfer.frame_spool import FrameSpool


@given(st.lists(st.sampled_from([0.0, 0.5, 1.0, 1.5, 7.0, 7.25]), max_size=60), st.integers(1, 9), st.integers(1, 4))
def test_frames_come_back_by_time_and_then_as_they_came(times_s: list[float], run: int, block: int) -> None:
    frames = [(at_s, number, bytes([number])) for number, at_s in enumerate(times_s)]
    with (
        TemporaryDirectory() as folder,
        pytest.MonkeyPatch.context() as patch,
        closing(FrameSpool(Path(folder), run)) as spool,
    ):
        patch.setattr(frame_spool, "_BLOCK", block)
        for frame in frames:
            spool.add(frame)
        assert spool.n == len(frames)
        expected = sorted(frames, key=lambda frame: frame[0])
        assert list(spool) == expected
        assert list(spool) == expected  # again
        if expected:
            assert (spool.first_s, spool.last_s) == (expected[0][0], expected[-1][0])


def test_what_does_not_fit_into_memory_goes_to_the_folder_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(frame_spool, "_IN_MEMORY", 100)
    with closing(FrameSpool(tmp_path, run=10)) as spool:
        for number in range(95):
            spool.add((95.0 - number, number, b"\1" * 8))
        assert [frame[1] for frame in spool] == list(range(95))[::-1]
    assert not list(tmp_path.iterdir())
