"""What every snapshot is sent with comes from the recorder, the replay, the event log and the configuration."""

from types import SimpleNamespace

import pytest

from app.service.state import ServiceStateReader, recording_state

SESSION = SimpleNamespace(id="s1", started_wall_ns=5_500_000_000, frames=7, size_bytes=4096)


@pytest.mark.parametrize("session", [None, SESSION])
def test_the_session_being_recorded_is_told(session):
    recorder = SimpleNamespace(session=session)
    state = recording_state(recorder)
    if session is None:
        assert state is None
    else:
        assert (state.session_id, state.since_ns, state.frames, state.bytes) == ("s1", 5_500_000_000, 7, 4096)


def test_every_part_is_asked_each_time():
    replay = SimpleNamespace(state=lambda: {"position_s": 1.0})
    events = SimpleNamespace(store=SimpleNamespace(last_id=41))
    in_force = SimpleNamespace(stored_hash=lambda: "abc")
    run = SimpleNamespace(id="a1")
    state = ServiceStateReader(SimpleNamespace(session=SESSION, stall=None), replay, events, in_force, run)
    assert state.at(7_250_000_000).sent_s == 7.25
    assert state.at(0).last_event_id == 41
    assert state.at(0).run == "a1"
    events.store.last_id = 42
    now = state.at(0)
    assert (now.last_event_id, now.config_stored_hash, now.replay) == (42, "abc", {"position_s": 1.0})
    assert now.recording.session_id == "s1"
