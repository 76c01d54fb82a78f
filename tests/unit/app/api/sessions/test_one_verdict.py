"""One trip has one verdict: the same code, cell and size wherever it is shown, and kept with the session."""

import json
from dataclasses import dataclass

import pytest

from app.analysis.root_cause.from_session import causes_of
from app.cli import main
from app.sessions.reading.reader import SessionFile
from simulator.library import find_scenario
from tests.recorded.service_car import Car

JOINT, MORE_MOHM = 63, 14.0


@dataclass
class Tripped:
    """A data folder with a joint's trip in it, and what the service answered at its end."""

    folder: object
    session_id: str
    snapshot: dict
    box: dict
    report: dict


@pytest.fixture(scope="module")
def tripped(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tripped")
    with Car(folder, find_scenario("clean-endurance")) as car:
        car.run(60.0)
        car.player.faults.inject("joint-resistance-high", JOINT, MORE_MOHM)
        car.run(40.0)
        snapshot, session_id = car.get("/snapshot"), car.end_recording()
        listed = car.get(f"/sessions/{session_id}/blackboxes")["boxes"]
        (box,) = (car.get(f"/blackboxes/{each['id']}") for each in listed if each["severity"] == "trip")
        return Tripped(folder, session_id, snapshot, box, car.get(f"/sessions/{session_id}/report"))


def shown(cause):
    """Return what has to be the same everywhere of a cause as JSON."""
    return tuple(cause[name] for name in ("code", "cell", "pack", "size", "low", "high", "unit", "judged", "revised"))


def command(capsys, folder, *words):
    """Run a command on the data folder and return what it prints as JSON."""
    capsys.readouterr()
    assert main(("sessions", *words, "--data", str(folder), "--json")) == 0
    return json.loads(capsys.readouterr().out)


def test_banner_black_box_report_and_command_line_agree(tripped, capsys):
    trips = [each["cause"] for each in tripped.snapshot["alarms"] if each["severity"] == "trip"]
    assert trips
    boxes = command(capsys, tripped.folder, "blackbox", tripped.session_id)
    printed = next(each for each in boxes if each["severity"] == "trip")
    reported = command(capsys, tripped.folder, "report", tripped.session_id)
    found = [*trips, tripped.box["cause"], tripped.report["causes"][0], printed["cause"], reported["causes"][0]]
    assert {shown(each) for each in found} == {shown(tripped.box["cause"])}
    assert (tripped.box["cause"]["code"], tripped.box["cause"]["cell"]) == ("joint-resistance-high", JOINT)
    assert printed == tripped.box


def test_the_cell_has_the_condition_and_the_size_of_its_trip_on_every_page(tripped):
    cause = tripped.box["cause"]
    of_cell = [each for each in tripped.snapshot["findings"] if each["cell"] == JOINT]
    assert [(each["code"], each["size"], each["low"], each["high"]) for each in of_cell] == [
        (cause["code"], cause["size"], cause["low"], cause["high"])
    ]
    assert cause["low"] <= 1e-3 * MORE_MOHM <= cause["high"]
    whys = [each["args"]["finding"] for each in tripped.report["findings"]["why"] if "finding" in each["args"]]
    assert {each["args"]["size"]["value"] for each in whys} == {1000 * cause["size"]}
    known = [each["args"]["finding"] for each in tripped.box["findings"] if "finding" in each["args"]]
    assert {each["args"]["size"]["value"] for each in known} <= {1000 * cause["size"]}


def test_what_the_session_keeps_is_what_its_file_is_asked_for(tripped):
    with SessionFile(tripped.folder / "sessions" / f"{tripped.session_id}.sqlite") as session:
        first = causes_of(session)[0]
    assert (first.code, first.cell, first.size, first.judged) == tuple(
        tripped.box["cause"][name] for name in ("code", "cell", "size", "judged")
    )
