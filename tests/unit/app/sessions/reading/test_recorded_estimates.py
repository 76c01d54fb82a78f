import numpy as np
import pytest

from app.sessions.reading.reader import SessionFile
from app.sessions.reading.recorded_estimates import RecordedEstimates
from app.sessions.recording.recorder import Recorder

MONO_NS = 5_000 * 10**9


@pytest.fixture
def session(recorder: Recorder, stream):
    """90 s at 10 Hz with an estimate each, 10 s of silence, 30 s more."""
    info = recorder.start()
    stream.feed(recorder, 900)
    stream.skip(100)
    stream.feed(recorder, 300)
    recorder.flush()
    with SessionFile(info.path) as session:
        yield session


@pytest.mark.parametrize("at_s", [0.0, 0.1, 59.9, 60.0, 89.9, 100.0, 129.9])
def test_the_estimate_of_an_instant_is_that_of_its_sample(session: SessionFile, at_s: float) -> None:
    found = RecordedEstimates(session).at(MONO_NS + round(at_s * 1e9))
    assert found is not None
    soc, sigma = found
    count = round(at_s * 10) + 1
    assert soc == pytest.approx(np.linspace(0.9, 0.8, 96) - count * 1e-4, abs=1.1e-5)
    assert sigma == pytest.approx(np.full(96, 0.01))


def test_between_samples_the_last_one_counts_for_two_seconds(session: SessionFile) -> None:
    recorded = RecordedEstimates(session)
    assert recorded.at(MONO_NS + 91_800_000_000) is not None
    assert recorded.at(MONO_NS + 92_500_000_000) is None
    assert recorded.at(MONO_NS - 1_000_000_000) is None


def test_going_on_and_jumping_back_give_the_same(session: SessionFile) -> None:
    recorded = RecordedEstimates(session)
    order = [*range(0, 89, 7), 3, 120, 40]
    found = [recorded.at(MONO_NS + at_s * 10**9) for at_s in order]
    for at_s, estimate in zip(order, found, strict=True):
        fresh = RecordedEstimates(session).at(MONO_NS + at_s * 10**9)
        assert estimate is not None
        assert fresh is not None
        np.testing.assert_array_equal(estimate[0], fresh[0])


def test_a_session_without_estimates_tells_none(recorder: Recorder, stream) -> None:
    info = recorder.start()
    recorder.frame(*stream.next()[:2], 0, stream.next()[2], True)
    recorder.flush()
    with SessionFile(info.path) as session:
        assert RecordedEstimates(session).at(MONO_NS) is None
