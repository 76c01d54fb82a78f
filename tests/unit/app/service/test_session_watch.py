"""What is wrong without having tripped anything is named while it is recorded, by the judge of recorded sessions."""

from types import SimpleNamespace

import pytest

from app.errors import NotNow
from app.service import session_watch
from app.service.session_watch import EVERY_S, SessionWatch
from app.words import Message, condition, sentence
from tests.fake_clock import FakeClock


def cause(code, cell=None):
    message = sentence(condition(code))
    nothing = dict.fromkeys(("pack", "size", "low", "high", "since", "judged"))
    return SimpleNamespace(
        code=code, cell=cell, message=message, confidence=0.9, others=[], unit="", revised=False, **nothing
    )


class Recording:
    """A recorder, a pipeline and a worker of a made-up session; `found` is what each look finds."""

    def __init__(self):
        self.found, self.named, self.looks, self.clock = [], [], 0, FakeClock()
        self.recorder = SimpleNamespace(flush=lambda: None, session_id=None)
        catalogue = SimpleNamespace(path=lambda session_id: session_id)
        workers = SimpleNamespace(run=self._run)
        pipeline = SimpleNamespace(name=lambda causes: self.named.append([each.code for each in causes]))
        self.watch = SessionWatch(self.recorder, catalogue, workers, pipeline, self.clock)

    def _run(self, limits, function, path):
        self.looks += 1
        assert function is session_watch.causes_without_trip
        if isinstance(self.found, Exception):
            raise self.found
        return self.found

    def go_on(self, seconds):
        self.clock.advance(seconds)
        self.watch.on_output(None, self.clock.monotonic_ns())
        self.watch.wait()


@pytest.fixture
def recording():
    recording = Recording()
    recording.go_on(1.0)
    recording.recorder.session_id = "20260921T141320Z"
    recording.go_on(1.0)
    yield recording
    recording.watch.stop()


def test_what_two_looks_find_is_named_and_ends_with_the_look_that_does_not_find_it(recording):
    recording.found = [cause("eeprom-worn")]
    recording.go_on(EVERY_S)
    recording.go_on(EVERY_S)
    recording.found = []
    recording.go_on(EVERY_S)
    assert recording.named == [["eeprom-worn"], []]


def test_the_end_of_a_recording_is_looked_at_once_and_says_nothing_against_what_was_found(recording):
    recording.found = [cause("can-noise")]
    recording.recorder.session_id = None
    recording.go_on(1.0)
    recording.go_on(EVERY_S)
    recording.go_on(EVERY_S)
    assert recording.named == [["can-noise"]]


@pytest.mark.parametrize("found", [None, NotNow(Message("workers-busy")), ValueError("damaged")])
def test_a_look_that_cannot_be_made_changes_nothing_and_the_next_one_is_made(recording, found):
    recording.found = found
    recording.go_on(EVERY_S)
    assert (recording.looks, recording.named) == (1, [])
    recording.found = []
    recording.go_on(EVERY_S)
    assert (recording.looks, recording.named) == (2, [])  # one look ends nothing that was named before a restart
    recording.go_on(EVERY_S)
    assert (recording.looks, recording.named) == (3, [[]])
