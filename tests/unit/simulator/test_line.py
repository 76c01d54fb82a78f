import numpy as np

from firmware_protocol.framing import LINE_BYTES_PER_S
from simulator.simulation import UartLine


def test_frames_one_after_the_other_take_the_line_rate():
    line = UartLine(np.random.default_rng(1))
    now_s = 0.0
    for _ in range(100):
        line.send(b"\0" * 200, now_s)
        now_s = line.busy_until_s
        assert line.take() == b"\0" * 200
    assert abs(now_s - 20_000 / LINE_BYTES_PER_S) < 1e-9


def test_a_frame_on_an_idle_line_starts_at_once():
    line = UartLine(np.random.default_rng(1))
    line.send(b"abc", 5.0)
    assert abs(line.busy_until_s - (5.0 + 3 / LINE_BYTES_PER_S)) < 1e-9


def test_noise_changes_bits_and_keeps_the_length():
    line = UartLine(np.random.default_rng(1))
    line.noise_per_byte = 0.05
    damaged = line.disturb(bytes(10_000))
    changed = sum(byte != 0 for byte in damaged)
    assert len(damaged) == 10_000
    assert 300 < changed < 700
    assert all(byte.bit_count() <= 1 for byte in damaged)


def test_a_stuck_line_carries_nothing():
    line = UartLine(np.random.default_rng(1))
    line.is_stuck = True
    assert line.disturb(b"abc") == b""


def test_drop_outs_cut_frames_short():
    line = UartLine(np.random.default_rng(1))
    line.is_dropping = True
    lengths = {len(line.disturb(bytes(50))) for _ in range(40)}
    assert len(lengths) > 10
    assert max(lengths) <= 50
