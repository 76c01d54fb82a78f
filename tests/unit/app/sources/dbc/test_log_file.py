import can
import numpy as np
import pytest

from app.sources.dbc import frames as columns
from app.sources.dbc.frames import load_log

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


def test_frames_are_put_in_the_order_of_their_time_and_of_one_instant_stay_as_they_came(tmp_path):
    path = tmp_path / "bus.log"
    path.write_text("".join(f"(17500000{t:02d}.000000) can0 123#{k:02X}\n" for k, t in enumerate([3, 1, 2, 1])))
    assert load_log(path).data[:, 0].tolist() == [1, 3, 2, 0]


def test_a_log_is_the_same_whatever_part_of_it_is_taken_at_once(tmp_path, monkeypatch):
    path = tmp_path / "mixed.log"
    lines = [f"({9 - k // 2}.0) can0 {0x100 + k:03X}#{k:02X}" for k in range(7)] + ["(3.5) can0 700##1" + "AB" * 64]
    path.write_text("\n".join(lines) + "\n")
    whole = load_log(path)
    assert whole.data.shape == (8, 64)
    assert whole.can_id.tolist() == [0x700, 0x106, 0x104, 0x105, 0x102, 0x103, 0x100, 0x101]  # of one time in order
    monkeypatch.setattr(columns, "AT_ONCE", 3)
    parts = load_log(path)
    for name in ("t_ns", "can_id", "length", "data"):
        assert getattr(parts, name).tolist() == getattr(whole, name).tolist()
        assert getattr(parts, name).dtype == getattr(whole, name).dtype
