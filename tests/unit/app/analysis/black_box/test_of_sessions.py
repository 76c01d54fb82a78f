"""Sessions that came from elsewhere get their black boxes in the background."""

from dataclasses import asdict

import numpy as np
import pytest

from app.analysis.black_box.from_session import BlackBoxesOfSessions, black_boxes, keep_black_boxes, stored_box
from app.sessions.black_box_store import BlackBoxStore, StoredBox
from app.sessions.catalogue import Catalogue
from app.sessions.reading.reader import SessionFile

TIME_S = np.arange(0.0, 50.0, 0.5)
TRIP = {"at_s": 20.0, "severity": "trip", "code": "trip-cell-undervoltage", "text": "under-voltage", "cell": 3}


@pytest.fixture
def store(tmp_path):
    made = BlackBoxStore(tmp_path / "blackboxes.sqlite")
    yield made
    made.close()


def boxes_of(store, tmp_path, *, is_simulated=False):
    """Look at the sessions, and return what there is."""
    made = BlackBoxesOfSessions(Catalogue(tmp_path / "sessions"), store, is_simulated=is_simulated)
    made.read_new()
    return {box.session_id for box in store.stored()}


def test_a_session_with_a_trip_has_its_box_without_being_opened(make_session, store, tmp_path):
    make_session(TIME_S, np.zeros(100))
    tripped = make_session(TIME_S, np.zeros(100), events=[TRIP]).stem
    assert boxes_of(store, tmp_path) == {tripped}


def test_a_damaged_session_does_not_keep_the_others_from_their_boxes(make_session, store, tmp_path):
    broken, whole = (make_session(TIME_S, np.zeros(100), events=[TRIP], start_s=1.79e9 + 1e5 * k) for k in (2, 1))
    raw = bytearray(broken.read_bytes())
    raw[20_000:-4096] = bytes(len(raw) - 24_096)
    broken.write_bytes(raw)
    assert boxes_of(store, tmp_path) == {whole.stem}


def test_the_simulated_car_has_boxes_of_its_own_sessions(make_session, store, tmp_path):
    make_session(TIME_S, np.zeros(100), events=[TRIP])
    simulated = make_session(
        TIME_S, np.zeros(100), events=[TRIP], start_s=1.79e9 + 1e5, metadata={"source": "simulator"}
    ).stem
    assert boxes_of(store, tmp_path, is_simulated=True) == {simulated}


def test_a_box_that_an_earlier_version_kept_under_its_code_is_no_second_one(make_session, store, tmp_path):
    path = make_session(TIME_S, np.zeros(100), events=[TRIP | {"code": "trip-v-min"}])
    with SessionFile(path) as session:
        (box,) = black_boxes(session)
        assert box.code == "trip-cell-undervoltage"
        old = box.id.replace(box.code, "trip-v-min")
        body = asdict(box) | {"id": old, "code": "trip-v-min"}
        store.add(StoredBox(old, box.at, path.stem, "trip-v-min", "trip", 3, box.message, box.is_complete), body)
        assert [(each.id, each.code) for each in keep_black_boxes(session, store)] == [(old, box.code)]
    assert stored_box(store, old).code == box.code
