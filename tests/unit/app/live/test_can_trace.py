import pytest

from app.live.can_trace import LENGTH, MAX_IDS, CanTrace
from app.sources.items import CanItem


def item(can_id=1, data=b"\0\0", t_s=0.0):
    return CanItem(round(t_s * 1e9), 0, can_id, data)


def test_the_newest_frames_are_kept_oldest_first():
    trace = CanTrace()
    for i in range(LENGTH + 10):
        trace.add(item(t_s=i))
    assert [round(f.t_mono_ns / 1e9) for f in trace.latest(3)] == [LENGTH + 7, LENGTH + 8, LENGTH + 9]
    assert len(trace.latest(10**6)) == LENGTH


def test_each_id_has_its_period_count_and_changed_bytes():
    trace = CanTrace()
    for i in range(50):
        trace.add(item(7, bytes([5, i]), i * 0.1))
    known = trace.by_id()[7]
    assert known.count == 50
    assert known.period_s == pytest.approx(0.1)
    assert known.changed == 0b10
    trace.add(item(7, bytes([5, 49, 1]), 5.0))
    assert trace.by_id()[7].changed == 0b100


def test_noise_on_the_ids_does_not_fill_the_memory():
    trace = CanTrace()
    for can_id in range(MAX_IDS + 100):
        trace.add(item(can_id))
    assert len(trace.by_id()) == MAX_IDS
    assert trace.latest(1)[0].can_id == MAX_IDS + 99
