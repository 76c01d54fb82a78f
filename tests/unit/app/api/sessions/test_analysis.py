"""Looking back on a session over HTTP; what the figures are is tested where they are made."""

import json

import numpy as np
import pytest

from app.analysis.document import SLOT

START_S = 1_790_000_000.0
LAPS = [
    {"start_s": START_S + 10, "end_s": START_S + 40, "driver": "Anna"},
    {"start_s": START_S + 40, "end_s": START_S + 80},
]


@pytest.fixture(autouse=True)
def template(tmp_path, monkeypatch):
    """A page that is built in a moment."""
    page = tmp_path / "document.html"
    page.write_text(f"<html>{SLOT}</script></html>")
    monkeypatch.setattr("app.analysis.document.TEMPLATE", page)


def embedded(answer):
    """Return kind, language and data of a document."""
    assert answer.headers["content-type"].startswith("text/html")
    inside = json.loads(answer.text.split(SLOT)[1].split("</script>")[0])
    return inside["kind"], inside["language"], inside["data"]


@pytest.fixture
def session_id(make_session):
    time_s = np.arange(0.0, 100.0, 0.5)
    markers = [(k * 30.0, "lap", "") for k in range(4)]
    return make_session(time_s, 80 + 40 * np.sin(time_s), 3.7, 25, 0.8, markers=markers).stem


def test_laps_are_read_settled_and_taken_back(client, session_id):
    laps = f"/api/v1/sessions/{session_id}/laps"
    found = client.get(laps).json()
    assert (found["source"], len(found["laps"])) == ("markers", 3)
    settled = client.put(laps, json={"laps": LAPS})
    assert settled.status_code == 200
    assert client.get(laps).json() == settled.json()
    assert [each["lap"]["driver"] for each in settled.json()["laps"]] == ["Anna", ""]
    assert "laps-settled" in [event["code"] for event in client.get("/api/v1/events").json()["events"]]
    assert client.delete(laps).json() == found


@pytest.mark.parametrize(("asked", "got"), [(20, 20), (50, 30)])  # a lap is 30 s at 2 Hz: two samples in each of 30
def test_an_overlay_has_a_trace_a_lap(client, session_id, asked, got):
    path = f"/api/v1/sessions/{session_id}/laps/overlay?lap=0&lap=2&signal=current_a&points={asked}"
    answer = client.get(path).json()
    assert [(trace["lap"], len(trace["minimum"])) for trace in answer["laps"]] == [(0, got), (2, got)]
    assert (answer["points"], answer["unit"]) == (got, "A")


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("sessions/none/laps", 404),
        ("sessions/{id}/laps?source=can", 422),
        ("sessions/{id}/laps?source=guess", 422),
        ("sessions/{id}/laps?source=signal", 422),
        ("sessions/{id}/laps?source=signal&lap_signal=speed", 422),
        ("sessions/{id}/laps/overlay?lap=7", 422),
        ("sessions/{id}/laps/overlay?lap=0&signal=speed", 422),
        ("sessions/{id}/laps/overlay?lap=0&along=speed", 422),
        ("sessions/{id}/laps/overlay", 422),
    ],
)
def test_what_there_is_not_is_named(client, session_id, path, status):
    answer = client.get("/api/v1/" + path.format(id=session_id))
    assert answer.status_code == status
    assert answer.headers["content-type"] == "application/problem+json"


def test_laps_that_overlap_are_refused_by_name(client, session_id):
    bad = [LAPS[0], LAPS[1] | {"start_s": START_S + 20}]
    answer = client.put(f"/api/v1/sessions/{session_id}/laps", json={"laps": bad})
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["field"] == "laps[2].start"


@pytest.fixture
def tripped(make_session):
    time_s = np.arange(0.0, 30.0, 0.5)
    event = {
        "severity": "trip",
        "code": "trip-cell-undervoltage",
        "text": "under",
        "cell": 3,
        "value": 2.4,
        "limit": 2.5,
        "unit": "V",
    }
    return make_session(time_s, np.full(60, 50.0), 3.7, 25, 0.8, events=[event | {"at_s": 15.0}]).stem


def test_the_black_boxes_of_an_old_session_are_made_when_asked_for_and_outlive_it(client, tripped):
    assert client.get("/api/v1/blackboxes").json() == {"boxes": [], "next_cursor": None}
    (listed,) = client.get(f"/api/v1/sessions/{tripped}/blackboxes").json()["boxes"]
    assert (listed["code"], listed["cell"], listed["session_id"]) == ("trip-cell-undervoltage", 3, tripped)
    assert listed["message"] == {"code": "verbatim", "args": {"text": "under"}, "text": "under"}
    assert client.delete(f"/api/v1/sessions/{tripped}").status_code == 200
    assert client.get("/api/v1/blackboxes").json()["boxes"] == [listed]
    box = client.get(f"/api/v1/blackboxes/{listed['id']}").json()
    assert box["limits"]["v_cell_min"] == 2.5
    assert (box["findings"][0]["code"], box["findings"][0]["text"]) == ("box-event", "Under.")
    assert embedded(client.get(f"/api/v1/blackboxes/{listed['id']}/page")) == ("black-box", "en", box)
    assert client.get("/api/v1/blackboxes/none").status_code == 404


def test_who_asks_for_all_black_boxes_has_those_of_old_sessions_made_meanwhile(client, tripped):
    client.get("/api/v1/blackboxes")
    client.app.state.parts.service.boxes_of_sessions._thread.join()
    (box,) = client.get("/api/v1/blackboxes").json()["boxes"]
    assert (box["session_id"], box["cell"]) == (tripped, 3)


def test_a_report_says_what_limited_and_a_page_holds_it(client, session_id, tripped):
    report = client.get(f"/api/v1/sessions/{tripped}/report").json()
    assert report["findings"]["limited"][0]["text"].startswith("Tripped: under (pack 1, cell 4)")
    assert sum(report["histograms"]["current"]["seconds"]) == pytest.approx(29.5)
    assert report["findings"]["limited"][0]["code"] == "report-tripped"
    page = f"/api/v1/sessions/{tripped}/report/page"
    assert embedded(client.get(page, params={"language": "nb"})) == ("report", "nb", report)
    assert client.get(page, params={"language": "xx"}).status_code == 422
    compared = client.get(f"/api/v1/sessions/{session_id}/compare/{tripped}").json()
    assert compared["b"]["figures"] == report["figures"]
    assert compared["a"]["id"] == session_id
    assert client.get(f"/api/v1/sessions/{session_id}/compare/none").status_code == 404
