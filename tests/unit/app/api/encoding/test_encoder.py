"""A snapshot is encoded once, however many read it."""

import json
from dataclasses import replace

import pytest

from app.api.encoding.encoder import SnapshotEncoder
from app.live.pipeline_factory import PipelineFactory
from app.telemetry.service_state import ServiceState


class CountedState:
    """Counts how often the service's state is asked for."""

    def __init__(self) -> None:
        self.asked = 0

    def now(self) -> ServiceState:
        self.asked += 1
        return ServiceState(recording=None, replay=None, last_event_id=self.asked, config_stored_hash=None)


@pytest.fixture
def snapshot(master):
    return PipelineFactory("coulomb", "samsung-25r-10p").pipeline("serial").feed(master.frame()).snapshot


def test_the_same_snapshot_is_encoded_once(snapshot):
    state = CountedState()
    encoder = SnapshotEncoder(state)
    first = encoder.encode(snapshot)
    assert encoder.encode(snapshot) is first
    assert state.asked == 1


def test_another_snapshot_is_encoded_with_the_state_of_then(snapshot):
    encoder = SnapshotEncoder(CountedState())
    encoder.encode(snapshot)
    body = json.loads(encoder.encode(replace(snapshot, sequence=snapshot.sequence + 1)))
    assert body["seq"] == snapshot.sequence + 1
    assert body["last_event_id"] == 2
