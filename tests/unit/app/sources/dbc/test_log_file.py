import can
import numpy as np
import pytest

from app.sources.dbc.log_file import load_log

FRAMES = [
    (0.0, 0x123, False, bytes(range(8)), False),
    (0.25, 0x18FF50E5, True, b"\x01\x02", False),
    (0.5, 0x7FF, False, b"", False),
    (1.0, 0x345, False, bytes(range(64)), True),
]
START_S = 1_750_000_000.0


@pytest.mark.parametrize(("suffix", "with_fd"), [(".log", True), (".asc", True), (".blf", True), (".trc", False)])
def test_logs_of_every_tool_are_the_same_frames(tmp_path, suffix, with_fd):
    path = tmp_path / f"bus{suffix}"
    frames = [frame for frame in FRAMES if with_fd or not frame[4]]
    with can.Logger(path) as writer:
        for t, can_id, is_extended, data, is_fd in frames:
            writer(can.Message(START_S + t, can_id, is_extended, data=data, is_fd=is_fd, channel=0))
    found = load_log(path)
    assert found.can_id.tolist() == [can_id | (1 << 31 if extended else 0) for _, can_id, extended, _, _ in frames]
    assert found.length.tolist() == [len(data) for _, _, _, data, _ in frames]
    assert [bytes(row[:n]) for row, n in zip(found.data, found.length, strict=True)] == [f[3] for f in frames]
    np.testing.assert_allclose((found.t_ns - found.t_ns[0]) / 1e9, [t for t, *_ in frames], atol=2e-3)
