"""Lists by pages over HTTP: all pages together are the list, whatever comes or goes between two of them."""

from itertools import chain

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.api.web.paging import page_of
from tests.campaign import examples

START_S = 1_790_000_000.0
TIME_S = np.arange(0.0, 3.0, 0.5)
PAGED = {
    "/sessions": "sessions",
    "/sessions/{session_id}/markers": "markers",
    "/sessions/{session_id}/blackboxes": "boxes",
    "/blackboxes": "boxes",
    "/events": "events",
    "/signed-log": "records",
    "/config/history": "records",
    "/calibration/slave": "checks",
}


def by_pages(client, path, field, limit, **asked):
    """Follow the cursor to the end; return the pages."""
    pages, cursor = [], {}
    while True:
        answer = client.get(f"/api/v1{path}", params={"limit": limit, **asked, **cursor})
        assert answer.status_code == 200, answer.text
        pages.append(answer.json()[field])
        if answer.json()["next_cursor"] is None:
            return pages
        cursor = {"cursor": answer.json()["next_cursor"]}


@pytest.fixture
def sessions(make_session):
    markers = [(0.1 * k, "note", f"note {k}") for k in range(5)]
    return [
        make_session(
            TIME_S, TIME_S, 3.7, 25, start_s=START_S + 60 * (k // 2), markers=markers
        ).stem  # by twos at one time
        for k in range(7)
    ]


@given(numbers=st.lists(st.tuples(st.integers(0, 3), st.sampled_from("abc"))), limit=st.integers(1, 9))
@settings(max_examples=examples(100), deadline=None)
def test_the_pages_together_are_the_list(numbers, limit):
    for newest_first in (True, False):
        listed = sorted(set(numbers), reverse=newest_first)
        found, cursor = [], None
        while True:
            page, cursor = page_of(listed, lambda item: item, limit, cursor, newest_first=newest_first)
            found += page
            if cursor is None:
                break
            assert len(page) == limit
        assert found == listed


def test_every_list_of_the_document_that_takes_a_cursor_is_tried_here(client):
    paths = client.get("/api/v1/openapi.json").json()["paths"]
    paged = {
        path.removeprefix("/api/v1")
        for path, methods in paths.items()
        if {"limit", "cursor"} <= {each["name"] for each in methods.get("get", {}).get("parameters", ())}
    }
    assert paged == PAGED.keys()


@pytest.mark.parametrize(("path", "field"), PAGED.items())
def test_every_such_list_has_a_last_page_and_refuses_a_cursor_that_is_none(client, sessions, path, field):
    path = path.format(session_id=sessions[0])
    assert client.get(f"/api/v1{path}").json()["next_cursor"] is None
    for wrong in ("newest", "12~a/b", "-1"):
        answer = client.get(f"/api/v1{path}", params={"cursor": wrong})
        assert (answer.status_code, answer.json()["errors"][0]["field"]) == (422, "cursor")
    assert client.get(f"/api/v1{path}", params={"cursor": "9" * 19}).status_code == 200


def test_sessions_and_markers_come_by_pages(client, sessions):
    listed = client.get("/api/v1/sessions").json()["sessions"]
    assert sorted(each["id"] for each in listed) == sorted(sessions)
    pages = by_pages(client, "/sessions", "sessions", 3)
    assert [len(page) for page in pages] == [3, 3, 1]
    assert [*chain(*pages)] == listed
    assert [len(page) for page in by_pages(client, "/sessions", "sessions", 7)] == [7]
    pages = by_pages(client, f"/sessions/{sessions[0]}/markers", "markers", 2)
    assert [[each["text"] for each in page] for page in pages] == [
        ["note 0", "note 1"],
        ["note 2", "note 3"],
        ["note 4"],
    ]


def test_a_session_that_is_deleted_between_two_pages_moves_no_other(client, sessions):
    listed = [each["id"] for each in client.get("/api/v1/sessions").json()["sessions"]]
    first = client.get("/api/v1/sessions?limit=3").json()
    for gone in (listed[2], listed[0]):  # the one that the cursor names, and one before it
        assert client.delete(f"/api/v1/sessions/{gone}").status_code == 200
    rest = client.get("/api/v1/sessions", params={"cursor": first["next_cursor"]}).json()["sessions"]
    assert [each["id"] for each in rest] == listed[3:]


def test_events_come_by_pages_while_new_ones_are_told(client, sessions):
    for gone in sessions:
        client.delete(f"/api/v1/sessions/{gone}")
    before = client.get("/api/v1/events").json()["events"]
    assert len(before) >= len(sessions)
    first = client.get("/api/v1/events?limit=3").json()
    client.put("/api/v1/race-plan", json={"laps_to_go": 3, "reserve_soc": 0.1})  # told: one event more
    rest = by_pages(client, "/events", "events", 3, cursor=first["next_cursor"])
    assert first["events"] + [*chain(*rest)] == before
    kept = by_pages(client, "/events", "events", 2, after=before[3]["id"])
    assert [*chain(*kept)][-3:] == before[:3]


def test_the_signed_log_comes_by_pages(client):
    for laps in range(1, 6):
        client.put("/api/v1/race-plan", json={"laps_to_go": laps, "reserve_soc": 0.1})
    listed = client.get("/api/v1/signed-log").json()["records"]
    assert len(listed) == 5
    assert [*chain(*by_pages(client, "/signed-log", "records", 2))] == listed
