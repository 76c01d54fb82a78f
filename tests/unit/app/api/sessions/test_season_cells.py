"""The season over HTTP, out of six short sessions on the disk, one a day."""

import shutil

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import format_cell, load_cell
from app.season.estimates.results import Results, set_of
from app.season.estimates.session import EstimateJob, estimate_session
from app.season.lake.build import build_lake, session_files
from app.season.lake.place import LakeFolder
from tests.unit.app.conftest import SessionMaker

CELL = load_cell("samsung-25r-10p")
TIME_S = np.arange(0.0, 60.0, 0.25)
CURRENT_A = np.where((TIME_S > 11) & (TIME_S < 55), 60 + 50 * np.sin(TIME_S), 0.0)
START_S, DAY_S = 1_790_000_000.0, 86_400.0


def open_on(client, folder, made):
    """The client of a service that finds these sessions, and the lake that was built of them, in its folder."""
    shutil.copytree(made, folder, dirs_exist_ok=True)
    return client


@pytest.fixture(scope="module")
def season_made(tmp_path_factory):
    """The sessions and their lake."""
    folder = tmp_path_factory.mktemp("season")
    make_session = SessionMaker(folder / "sessions")
    for day in range(6):
        ohm = np.where(np.arange(96) == 30, 0.003, 0.002) + 1e-6 * day
        volts = CELL.ocv.voltage(0.8) - CURRENT_A[:, None] * ohm
        make_session(TIME_S, CURRENT_A, volts, 25, start_s=START_S + day * DAY_S, cell_file=format_cell(CELL))
    assert len(build_lake(LakeFolder(folder / "lake"), session_files([folder / "sessions"])).made) == 6
    return folder


@pytest.fixture
def season(client, season_made, tmp_path):
    return open_on(client, tmp_path, season_made)


def test_a_season_tells_sessions_trends_and_the_cell_that_limits(season):
    told = season.get("/api/v1/season").json()
    assert len(told["sessions"]) == told["all_sessions"] == 6
    assert (told["to_read"], told["is_kept"]) == (0, False)
    first = told["overviews"][0]["cells"][0]
    assert first["cell"] == 30
    assert first["resistance"] == pytest.approx(0.5, abs=0.1)
    assert first["reasons"][0]["code"] == "season-resists"
    assert told["overviews"][0]["groups"][0]["resistance"]["sessions"] == 6


def test_tags_are_set_found_and_refused(season):
    ids = [each["id"] for each in season.get("/api/v1/season").json()["sessions"]]
    for session in ids[3:]:
        answer = season.put(f"/api/v1/season/sessions/{session}/tags", json={"tags": {"tyres": "wet"}})
        assert answer.json()["tags"] == {"tyres": "wet"}
    found = season.get("/api/v1/season", params={"words": "tyres:wet"}).json()
    assert [each["id"] for each in found["sessions"]] == ids[3:]
    assert found["overviews"][0]["sessions"] == 3
    assert season.put(f"/api/v1/season/sessions/{ids[0]}/tags", json={"tags": {"colour": "red"}}).status_code == 422
    assert season.put("/api/v1/season/sessions/none/tags", json={"tags": {}}).status_code == 404


def test_a_cell_has_its_curves(season):
    (curves,) = season.get("/api/v1/season/cells/30").json()
    assert len(curves["resistance"]["measured"]) == 6
    assert curves["resistance"]["low"][-1] < curves["resistance"]["high"][-1]
    assert season.get("/api/v1/season/cells/96").status_code == 422


def test_a_swap_is_recorded_and_taken_back(season):
    when = START_S + 2.5 * DAY_S
    made = season.post("/api/v1/season/swaps", json={"cells": [30], "time_s": when, "note": "spare 4"})
    assert made.status_code == 201
    (swap,) = made.json()
    assert (swap["cells"], swap["note"], swap["time_s"]) == ([30], "spare 4", when)
    told = season.get("/api/v1/season").json()
    assert told["swaps"] == [swap]
    assert [swap["car"]] == told["cars"]  # the only one
    (cell,) = season.get("/api/v1/season/cells/30").json()
    assert cell["module"] == [0, 0, 0, 1, 1, 1]
    assert len(cell["resistance"]["measured"]) == 6
    assert cell["resistance"]["line"] == []  # only three sessions have the new one
    assert season.delete(f"/api/v1/season/swaps/{swap['id']}").status_code == 200
    assert season.delete(f"/api/v1/season/swaps/{swap['id']}").status_code == 404
    assert season.get("/api/v1/season/cells/30").json()[0]["module"] == [0] * 6


@pytest.mark.parametrize("body", [{"cells": []}, {"cells": [96]}, {"cells": [1], "time_s": -1}])
def test_a_swap_that_cannot_be_is_refused(season, body):
    assert season.post("/api/v1/season/swaps", json=body).status_code == 422
    assert season.get("/api/v1/season").json()["swaps"] == []


def test_what_estimating_again_changed_is_told(season, tmp_path):
    results, own = Results(tmp_path), set_of("session", None, "fused")
    results.begin(own)
    for path in session_files([tmp_path / "sessions"]):
        results.write(own, estimate_session(EstimateJob(str(path), (None,)))[0])
    changed = season.get("/api/v1/season/changes").json()
    assert changed["sets"] == [own.id]
    assert len(changed["changes"]) == 6
    assert changed["before"] is None


def test_a_season_without_sessions_is_empty(client):
    told = client.get("/api/v1/season").json()
    assert (told["sessions"], told["overviews"], told["cars"]) == ([], [], [])
    assert client.get("/api/v1/season/changes").json()["changes"] == []
    assert client.get("/api/v1/season/cells/3").json() == []


@pytest.fixture(scope="module")
def two_cars_made(tmp_path_factory):
    """Three days of each of two cars, one after the other, and their lake."""
    folder = tmp_path_factory.mktemp("two_cars")
    make_session = SessionMaker(folder / "sessions")
    for day in range(6):
        ohm = np.where(np.arange(96) == (30 if day % 2 else 60), 0.003, 0.002)
        volts = CELL.ocv.voltage(0.8) - CURRENT_A[:, None] * ohm
        more = {"start_s": START_S + day * DAY_S, "cell_file": format_cell(CELL)}
        make_session(TIME_S, CURRENT_A, volts, 25, metadata={"car": "E 26" if day % 2 else "E 25"}, **more)
    build_lake(LakeFolder(folder / "lake"), session_files([folder / "sessions"]))
    return folder


@pytest.fixture
def two_cars(client, two_cars_made, tmp_path):
    return open_on(client, tmp_path, two_cars_made)


def test_two_cars_are_told_apart_everywhere(two_cars):
    told = two_cars.get("/api/v1/season").json()
    assert told["cars"] == ["e-25", "e-26"]
    assert [(each["car"], each["sessions"], each["cells"][0]["cell"]) for each in told["overviews"]] == [
        ("e-25", 3, 60),
        ("e-26", 3, 30),
    ]
    assert [each["car"] for each in told["sessions"]] == ["e-25", "e-26"] * 3
    curves = two_cars.get("/api/v1/season/cells/30").json()
    assert [(each["car"], len(each["resistance"]["measured"])) for each in curves] == [("e-25", 3), ("e-26", 3)]
    report = two_cars.get("/api/v1/season/report").text
    assert '"car":"e-25"' in report.replace(" ", "")
    assert '"car":"e-26"' in report.replace(" ", "")


def test_a_swap_is_of_one_car_and_which_of_several_has_to_be_said(two_cars):
    for body in ({"cells": [30]}, {"cells": [30], "car": "green"}):
        answer = two_cars.post("/api/v1/season/swaps", json=body)
        assert answer.status_code == 422
        assert "e-25" in answer.text
        assert "e-26" in answer.text
    made = two_cars.post("/api/v1/season/swaps", json={"cells": [30], "time_s": START_S + 2.5 * DAY_S, "car": "e-26"})
    assert [swap["car"] for swap in made.json()] == ["e-26"]
    cells = two_cars.get("/api/v1/season/cells/30").json()
    assert {each["car"]: each["module"] for each in cells} == {"e-25": [0, 0, 0], "e-26": [0, 1, 1]}
    swaps = {car: two_cars.get("/api/v1/season", params={"car": car}).json()["swaps"] for car in ("e-25", "e-26")}
    assert swaps == {"e-25": [], "e-26": made.json()}


def test_one_car_is_chosen_and_one_that_there_is_not_is_refused(two_cars):
    told = two_cars.get("/api/v1/season", params={"car": "e-26"}).json()
    assert ([each["car"] for each in told["overviews"]], len(told["sessions"])) == (["e-26"], 3)
    assert told["cars"] == ["e-25", "e-26"]
    assert [each["car"] for each in two_cars.get("/api/v1/season/cells/3", params={"car": "e-26"}).json()] == ["e-26"]
    none = two_cars.get("/api/v1/season", params={"car": "e-27"}).json()
    assert (none["sessions"], none["overviews"]) == ([], [])  # the page offers the others
    for path in ("cells/3", "report"):
        answer = two_cars.get(f"/api/v1/season/{path}?car=e-27")
        assert answer.status_code == 422, path
        assert answer.json()["errors"][0]["field"] == "car"
