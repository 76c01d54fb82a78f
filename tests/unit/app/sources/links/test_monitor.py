import tracemalloc

import pytest

from app.sources.items import CanFault, LinkChange, UnframedBytes
from app.sources.links.monitor import LinkMonitor, rs232_monitor
from firmware_protocol.framing import BadFrame, BadReason, Frame


def opened():
    monitor = rs232_monitor("/dev/x")
    monitor.on_change(LinkChange(0, 0, "rs232", "open"))
    return monitor


def frame(sequence, uptime_ms=1000):
    return Frame(1, sequence, uptime_ms, b"", b"12345678")


def test_states_from_connecting_over_live_and_silent_to_lost():
    monitor = rs232_monitor("/dev/x")
    assert monitor.status(0).state == "connecting"
    monitor.on_change(LinkChange(0, 0, "rs232", "open"))
    assert monitor.status(0).state == "silent"
    monitor.on_frame(10, frame(0))
    assert monitor.status(20).state == "live"
    assert monitor.status(2_000_000_000).state == "silent"
    monitor.on_change(LinkChange(0, 0, "rs232", "lost", "unplugged"))
    status = monitor.status(2_000_000_000)
    assert (status.state, status.error) == ("lost", "unplugged")
    monitor.on_change(LinkChange(0, 0, "rs232", "open"))
    assert monitor.status(2_000_000_000).error is None
    assert rs232_monitor(None).status(0).state == "off"


@pytest.mark.parametrize(
    ("frames", "lost"),
    [
        ([(254, 1000), (255, 1000), (0, 1000), (3, 1000)], 2),  # also over the wrap
        ([(100, 50_000), (0, 10)], 0),  # a reset
        ([(7, 1000), (7, 1000)], 255),  # a whole turn
    ],
)
def test_gaps_in_the_sequence_are_lost_frames(frames, lost):
    monitor = opened()
    for sequence, uptime_ms in frames:
        monitor.on_frame(0, frame(sequence, uptime_ms))
    assert monitor.lost == lost


def test_reopening_counts_and_starts_the_sequence_anew():
    monitor = opened()
    assert monitor.status(0).reconnects == 0
    monitor.on_frame(0, frame(5))
    monitor.on_change(LinkChange(0, 0, "rs232", "open"))
    monitor.on_frame(0, frame(90))
    assert (monitor.reconnects, monitor.lost) == (1, 0)


def test_bad_frames_are_counted_by_kind_and_are_no_sign_of_life():
    monitor = opened()
    monitor.on_frame(0, BadFrame(BadReason.CRC, b"1"))
    monitor.on_frame(0, BadFrame(BadReason.COBS, b"1"))
    status = monitor.status(0)
    assert (status.crc_errors, status.resyncs, status.frames, status.age_s) == (1, 1, 0, None)


def test_bytes_that_are_no_frames_are_counted_and_the_last_are_kept_while_they_arrive():
    monitor = opened()
    for second in range(1, 4):
        monitor.on_unframed(UnframedBytes(second * 10**9, 0, 312, b"V=3.7"))
    status = monitor.status(3 * 10**9)
    assert (status.state, status.bytes, status.unframed) == ("silent", 936, "56 3d 33 2e 37")
    assert status.bytes_per_s == pytest.approx(312, rel=0.51)
    assert monitor.status(6 * 10**9).unframed is None
    monitor.on_unframed(UnframedBytes(7 * 10**9, 0, 1, b"V"))
    monitor.on_frame(7 * 10**9, frame(1))
    assert monitor.status(7 * 10**9).unframed is None


def test_rates_are_those_of_the_last_two_seconds():
    monitor = opened()
    for i in range(40):
        monitor.on_frame(i * 100_000_000, frame(i))
        monitor.on_snapshot(i * 100_000_000)
    status = monitor.status(4_000_000_000)
    assert 9 <= status.rate_hz <= 10
    assert monitor.status(9_000_000_000).rate_hz == 0


def test_what_nobody_asks_for_takes_no_more_memory_with_every_frame():
    monitor = opened()
    tracemalloc.start()
    try:
        for i in range(20_000):
            monitor.on_can_frame(i * 1_000_000_000, 8, is_extended=False)
        kept_bytes, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert kept_bytes < 50_000


def test_the_load_of_a_can_bus_is_its_frames_at_their_longest_against_the_bit_rate():
    monitor = LinkMonitor("slcan:x")
    assert monitor.status(0).line_load is None  # without a bit rate nothing can be said
    monitor.bit_rate = 500_000
    for i in range(200):  # 100 a second: 135 bits with 11-bit ids, 160 with 29-bit ones (CiA's worst cases)
        monitor.on_can_frame(i * 10_000_000, 8, is_extended=i % 2 == 1)
    load = monitor.status(1_990_000_000).line_load
    assert load == pytest.approx(100 * (135 + 160) / 2 / 500_000)
    assert LinkMonitor(None).status(0).line_load is None


def test_bytes_on_the_line_count_with_their_delimiters():
    monitor = opened()
    monitor.on_frame(0, frame(0))
    monitor.on_frame(0, BadFrame(BadReason.SHORT, b"123"))
    status = monitor.status(0)
    assert status.bytes == (8 + 2) + (3 + 2)
    assert status.bytes_per_s == pytest.approx(15 / 2)
    assert status.line_load == pytest.approx(7.5 / (115_200 / 11))


def test_a_link_is_live_for_a_second_after_a_good_frame():
    monitor = opened()
    assert not monitor.is_live(0)
    monitor.on_frame(5, frame(0))
    assert monitor.status(0).age_s == 0.0, "never negative"
    assert monitor.is_live(5 + 999_999_999)
    assert not monitor.is_live(5 + 1_000_000_000)
    monitor.on_frame(2_000_000_000, BadFrame(BadReason.CRC, b""))
    assert not monitor.is_live(2_000_000_000)


def fault(state, errors=1):
    return CanFault(0, 0, errors=errors, tx_errors=2, rx_errors=3, bus_state=state)


def test_the_controllers_counters_are_unknown_until_told_and_after_a_reopening():
    monitor = LinkMonitor("slcan:x")

    def told():
        status = monitor.status(0)
        return status.errors, status.tx_errors, status.rx_errors, status.bus_state

    assert told() == (None, None, None, None)
    monitor.on_fault(fault("passive", errors=4))
    assert told() == (4, 2, 3, "passive")
    monitor.on_change(LinkChange(0, 0, "can", "open"))
    assert told() == (None, None, None, None)
