"""Passports over HTTP, out of sessions on the disk."""

import sqlite3
import threading
from contextlib import closing

import numpy as np
import pytest

from app.analysis.passport.keeper import PassportKeeper
from app.analysis.passport.shapes import all_passports
from app.estimation.cell_model.cell_file import format_cell, load_cell
from app.sessions.catalogue import Catalogue
from firmware_protocol.memory_map import FIELDS

START_S = 1_790_000_000.0
DAY_S = 86_400.0
CELL = load_cell("samsung-25r-10p")
TIME_S = np.arange(0.0, 240.0, 0.5)
CURRENT_A = np.where((TIME_S > 30) & (TIME_S < 100), 60 + 50 * np.sin(TIME_S), 0.0)
OHM = np.where(np.arange(96) == 30, 0.003, 0.002)
LEAK = np.where(np.arange(96) == 50, 0.01, 0.0)


@pytest.fixture
def sessions(make_session):
    """Three days, one session each; the leaking cell is a little lower every morning."""
    made = []
    for day in range(3):
        open_v = CELL.ocv.voltage(0.8 - LEAK * day)
        bled = np.zeros((len(TIME_S), 6), dtype=int)
        bled[:, 4] = 0b100  # the third cell of the first pack
        made.append(
            make_session(
                TIME_S,
                CURRENT_A,
                open_v - CURRENT_A[:, None] * OHM,
                25,
                start_s=START_S + day * DAY_S,
                windows=((420, 20), (FIELDS["slave[0].cfgr"].offset, 6), (1884, 204), (2280, 116)),
                fields={"slave[0].cfgr": bled},
            ).stem
        )
    return made


def test_passports_are_read_once_and_outlive_their_sessions(sessions, tmp_path):
    keeper = PassportKeeper(tmp_path, Catalogue(tmp_path / "sessions"), CELL)
    assert keeper.read_new() == 3
    assert keeper.read_new() == 0
    before = keeper.passports()
    Catalogue(tmp_path / "sessions").delete(sessions[0])
    keeper.close()
    keeper = PassportKeeper(tmp_path, Catalogue(tmp_path / "sessions"), CELL)
    after = keeper.passports()
    keeper.close()
    assert after.sessions == tuple(sessions)
    assert after.n_by_todays_cell == 3  # these keep no cell file
    np.testing.assert_array_equal(after.resistance_ohm, before.resistance_ohm)
    assert after.resistance_relative[-1, 30] == pytest.approx(0.5, abs=0.03)
    assert after.self_discharge_per_day[-1, 50] == pytest.approx(0.01, rel=0.05)
    assert after.balancing_h[-1, [1, 2]] == pytest.approx([0, 3 * 239.5 / 3600], abs=0.01)


def test_another_cell_file_today_changes_nothing_of_a_session_that_keeps_its_own(make_session, tmp_path):
    """Also what is computed later, as self-discharge between two sessions, goes by the cell file of then."""
    for day in range(2):
        open_v = CELL.ocv.voltage(0.8 - LEAK * day)
        volts = open_v - CURRENT_A[:, None] * OHM
        make_session(TIME_S, CURRENT_A, volts, 25, start_s=START_S + day * DAY_S, cell_file=format_cell(CELL))
    keeper = PassportKeeper(tmp_path, Catalogue(tmp_path / "sessions"), load_cell("sanyo-ur18650w"))
    keeper.read_new()
    made = keeper.passports()
    keeper.close()
    assert made.n_by_todays_cell == 0
    assert made.self_discharge_per_day[-1, 50] == pytest.approx(0.01, rel=0.05)


class ReadsTheLastSessionMeanwhile(PassportKeeper):
    """Finishes a reading under way while an answer is made."""

    def __init__(self, *args, **kwargs):
        self.may_finish = threading.Event()
        super().__init__(*args, also=lambda _: self.may_finish.wait(30), **kwargs)

    def passports(self, car=""):
        made = super().passports(car)
        self.may_finish.set()
        self.read_new()  # after the one under way
        return made


def test_an_answer_made_while_the_last_session_is_read_says_that_there_is_more(make_session, tmp_path):
    """Else the page would show the car of the session before as that of the newest, and never ask again."""
    catalogue = Catalogue(tmp_path / "sessions")
    make_session(TIME_S[:60], CURRENT_A[:60], metadata={"car": "red"})
    keeper = ReadsTheLastSessionMeanwhile(tmp_path, catalogue, CELL)
    keeper.may_finish.set()
    keeper.read_new()
    keeper.may_finish.clear()
    make_session(TIME_S[:60], CURRENT_A[:60], start_s=START_S + DAY_S, metadata={"car": "blue"})
    keeper.update()
    answer = all_passports(keeper)
    assert (answer.car, answer.to_read) == ("red", 1)
    answer = all_passports(keeper)
    assert (answer.car, answer.to_read) == ("blue", 0)
    keeper.close()


def test_a_damaged_session_is_left_out_and_the_others_are_read(sessions, tmp_path):
    path = tmp_path / "sessions" / f"{sessions[1]}.sqlite"
    raw = bytearray(path.read_bytes())
    raw[20_000:-4096] = bytes(len(raw) - 24_096)
    path.write_bytes(raw)
    keeper = PassportKeeper(tmp_path, Catalogue(tmp_path / "sessions"), CELL)
    assert keeper.read_new() == 2
    keeper.close()


def test_a_swap_begins_a_new_line_until_it_is_taken_back(client, sessions):
    keeper = client.app.state.parts.service.passports
    keeper.read_new()
    passport = client.get("/api/v1/passport").json()
    assert passport["sessions"] == 3
    assert {drift["cell"] for drift in passport["drifts"]} == {30, 50}
    swapped = client.post(
        "/api/v1/passport/swaps", json={"cells": [30], "time_s": START_S + 2.5 * DAY_S, "note": "spare 4"}
    )
    assert swapped.status_code == 201
    (swap,) = swapped.json()["swaps"]
    assert (swap["cells"], swap["note"]) == ([30], "spare 4")
    early = client.post("/api/v1/passport/swaps", json={"cells": [50], "time_s": START_S + 0.5 * DAY_S}).json()
    assert {drift["cell"] for drift in early["drifts"]} == {
        50
    }  # leaks as the one before; of the new 30 nothing is known
    assert early["rank"][30] is None
    one = client.get("/api/v1/passport/50").json()
    assert [entry["line"] for entry in one["entries"]] == [0, 1, 1]
    assert one["entries"][1]["self_discharge_per_day"] is None
    assert client.delete(f"/api/v1/passport/swaps/{swap['id']}").status_code == 200
    assert client.delete(f"/api/v1/passport/swaps/{swap['id']}").status_code == 404
    assert len(client.get("/api/v1/passport").json()["swaps"]) == 1


@pytest.fixture
def two_cars(make_session):
    """Red and blue with one battery profile, in turns; cell 50 of red leaks, and nothing of blue does."""
    for day in range(4):
        car = ("red", "blue")[day % 2]
        volts = CELL.ocv.voltage(0.8 - LEAK * day * (car == "red")) - CURRENT_A[:, None] * OHM
        make_session(TIME_S, CURRENT_A, volts, 25, start_s=START_S + day * DAY_S, metadata={"car": car})


def test_each_car_has_passports_and_swaps_of_its_own(client, two_cars):
    keeper = client.app.state.parts.service.passports
    keeper.read_new()
    red, blue = (client.get("/api/v1/passport", params={"car": car}).json() for car in ("red", "blue"))
    assert (red["car"], red["cars"], red["sessions"], blue["sessions"]) == ("red", ["blue", "red"], 2, 2)
    assert red["self_discharge_per_day"][50] == pytest.approx(0.01, rel=0.05)
    assert blue["self_discharge_per_day"][50] == pytest.approx(0.0, abs=1e-4)
    assert client.get("/api/v1/passport").json()["car"] == "blue"  # drove last
    when = START_S + 1.5 * DAY_S
    swapped = client.post("/api/v1/passport/swaps", json={"cells": [50], "time_s": when, "car": "red"}).json()
    assert [swap["car"] for swap in swapped["swaps"]] == ["red"]
    lines = {}
    for car in ("red", "blue"):
        one = client.get("/api/v1/passport/50", params={"car": car}).json()
        lines[car] = [entry["line"] for entry in one["entries"]], len(one["swaps"])
    assert lines == {"red": ([0, 1], 1), "blue": ([0, 0], 0)}
    source = client.app.state.parts.service.season_source()
    assert [(swap.is_of("red"), swap.is_of("blue")) for swap in source.swaps] == [(True, False)]


def test_which_of_several_cars_a_swap_is_of_has_to_be_said(client, two_cars):
    client.app.state.parts.service.passports.read_new()
    for body in ({"cells": [50]}, {"cells": [50], "car": "green"}):
        answer = client.post("/api/v1/passport/swaps", json=body)
        assert answer.status_code == 422
        assert "blue" in answer.text
        assert "red" in answer.text
    assert client.get("/api/v1/passport?car=green").status_code == 422
    assert client.get("/api/v1/passport/50?car=green").status_code == 422


def test_what_was_kept_without_a_car_counts_for_every_car(two_cars, tmp_path):
    """A file of the version before: records learn their car from their sessions, of a deleted one nobody knows it."""
    path, catalogue = tmp_path / "passport.sqlite", Catalogue(tmp_path / "sessions")
    keeper = PassportKeeper(tmp_path, catalogue, CELL)
    assert keeper.read_new() == 4
    first, *others = keeper.passports("red").sessions + keeper.passports("blue").sessions
    keeper.close()
    with closing(sqlite3.connect(path)) as file, file:
        file.execute(
            "INSERT INTO swaps (t_wall_ns, cells, note) VALUES (?, '[50]', 'old')", (round(START_S * 1e9) - 1,)
        )
        for table in ("records", "swaps"):
            file.execute(f"ALTER TABLE {table} DROP COLUMN car")
        file.execute("PRAGMA user_version = 1")
    catalogue.delete(first)
    keeper = PassportKeeper(tmp_path, catalogue, CELL)
    assert keeper.read_new() == 0  # none is read again
    kept = {car: keeper.passports(car) for car in ("red", "blue")}
    swaps = keeper.swaps()
    keeper.close()
    assert kept["red"].sessions == (first, others[0])
    assert kept["blue"].sessions == (first, *others[1:])
    assert [made.line_now[50] for made in kept.values()] == [1, 1]
    assert [swap.is_of(car) for swap in swaps for car in ("red", "blue")] == [True, True]


def test_a_swap_without_a_car_is_of_the_only_one(client, sessions):
    keeper = client.app.state.parts.service.passports
    keeper.swap([3], START_S, "before any was read", None)
    keeper.read_new()
    keeper.swap([4], START_S, "", None)
    assert [swap.car for swap in keeper.swaps()] == [None, keeper.car()]
    assert len(client.get("/api/v1/passport").json()["swaps"]) == 2


@pytest.mark.parametrize("body", [{"cells": []}, {"cells": [96]}, {"cells": [1], "time_s": -1}])
def test_a_swap_that_cannot_be_is_refused(client, body):
    answer = client.post("/api/v1/passport/swaps", json=body)
    assert answer.status_code == 422
    assert client.get("/api/v1/passport").json()["swaps"] == []


def test_a_simulated_car_has_passports_of_its_own(make_session, tmp_path):
    make_session(TIME_S[:100], CURRENT_A[:100], metadata={"source": "simulator"})
    real = make_session(TIME_S[:100], CURRENT_A[:100], metadata={"source": "serial"}).stem
    unnamed = make_session(TIME_S[:100], CURRENT_A[:100]).stem
    catalogue = Catalogue(tmp_path / "sessions")
    cars, simulated = (PassportKeeper(tmp_path, catalogue, CELL, simulated=which) for which in (False, True))
    assert (cars.read_new(), simulated.read_new()) == (2, 1)
    assert set(cars.passports().sessions) == {real, unnamed}
    cars.close()
    simulated.close()


def test_the_black_boxes_of_old_sessions_are_made_on_the_way(client, make_session):
    event = {"at_s": 20.0, "severity": "trip", "code": "trip-v-min", "text": "under-voltage", "cell": 3}
    session_id = make_session(TIME_S[:100], CURRENT_A[:100], events=[event]).stem
    client.app.state.parts.service.passports.read_new()
    (box,) = client.get("/api/v1/blackboxes").json()["boxes"]
    assert (box["session_id"], box["cell"]) == (session_id, 3)


def test_who_asks_first_is_told_that_sessions_are_being_read(client, make_session):
    make_session(TIME_S[:100], CURRENT_A[:100])
    first = client.get("/api/v1/passport").json()
    assert first["sessions"] + first["to_read"] >= 1  # read already, or to come: never nothing
    keeper = client.app.state.parts.service.passports
    keeper._thread.join()
    done = client.get("/api/v1/passport").json()
    assert (done["sessions"], done["to_read"]) == (1, 0)


def test_what_was_derived_of_sessions_is_derived_again_where_its_file_was_damaged(sessions, tmp_path):
    seen, lost = [], threading.Event()

    def keeper():
        catalogue = Catalogue(tmp_path / "sessions")
        return PassportKeeper(tmp_path, catalogue, CELL, also=lambda each: seen.append(each.info.id), also_lost=lost)

    first = keeper()
    assert (first.read_new(), first.read_new()) == (3, 0)
    lost.set()  # what `also` kept
    assert (first.read_new(), first.read_new()) == (3, 0)
    assert sorted(seen) == sorted(2 * sessions)
    before = first.passports()
    first.close()
    (tmp_path / "passport.sqlite").write_bytes(b"garbage" * 1000)
    second = keeper()
    assert second.read_new() == 3
    assert second.passports().sessions == before.sessions
    second.close()
