"""A snapshot is encoded once, however many read it."""

import json
from dataclasses import replace

import pytest

from app.api.encoding.encoder import SnapshotEncoder
from app.live.pipeline_factory import PipelineFactory
from app.telemetry.service_state import ServiceState
from tests.fake_clock import FakeClock


class CountedState:
    """Counts how often the service's state is asked for."""

    def __init__(self) -> None:
        self.asked = 0

    def at(self, now_ns: int) -> ServiceState:
        self.asked += 1
        return ServiceState(None, None, last_event_id=self.asked, config_stored_hash=None, sent_s=now_ns / 1e9)


@pytest.fixture
def snapshot(master):
    return PipelineFactory("coulomb", "samsung-25r-10p").pipeline("serial").feed(master.frame()).snapshot


def test_the_same_snapshot_is_encoded_once(snapshot):
    state = CountedState()
    encoder = SnapshotEncoder(state, FakeClock())
    first = encoder.encode(snapshot)
    assert encoder.encode(snapshot) is first
    assert state.asked == 1


def test_another_snapshot_is_encoded_with_the_state_of_then(snapshot):
    encoder = SnapshotEncoder(CountedState(), FakeClock())
    encoder.encode(snapshot)
    body = json.loads(encoder.encode(replace(snapshot, sequence=snapshot.sequence + 1)))
    assert body["seq"] == snapshot.sequence + 1
    assert body["last_event_id"] == 2


def test_what_waits_before_it_is_asked_for_is_older_then(snapshot):
    clock = FakeClock(monotonic_s=snapshot.t_mono_ns / 1e9)
    encoder = SnapshotEncoder(CountedState(), clock)
    at_once = json.loads(encoder.encode(snapshot))
    clock.advance(2.5)
    later = json.loads(encoder.encode(snapshot))
    assert later["age"]["voltage"] - at_once["age"]["voltage"] == pytest.approx(2.5)
    assert later["links"]["rs232"]["age_s"] - at_once["links"]["rs232"]["age_s"] == pytest.approx(2.5)
    assert later["age"]["charger"] is None or later["age"]["charger"] > 2.4


def test_its_ages_are_those_of_the_time_that_it_is_sent_with_however_long_the_process_stood_between(snapshot):
    clock = FakeClock(monotonic_s=snapshot.t_mono_ns / 1e9)
    at_once = json.loads(SnapshotEncoder(CountedState(), clock).encode(snapshot))

    class Standing(FakeClock):
        """Each reading is a second and a half after the one before."""

        def monotonic_ns(self) -> int:
            self.advance(1.5)
            return super().monotonic_ns()

    standing = Standing(monotonic_s=snapshot.t_mono_ns / 1e9)
    body = json.loads(SnapshotEncoder(CountedState(), standing).encode(snapshot))
    older_s = body["age"]["voltage"] - at_once["age"]["voltage"]
    assert older_s == pytest.approx(body["sent_s"] - at_once["sent_s"], abs=1e-3)


def test_a_replays_ages_are_those_of_then(snapshot):
    clock = FakeClock(monotonic_s=snapshot.t_mono_ns / 1e9 + 3600)
    body = json.loads(SnapshotEncoder(CountedState(), clock).encode(replace(snapshot, source="replay")))
    assert body["age"]["voltage"] < 1
