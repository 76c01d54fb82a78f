"""One trip has one verdict: the same code, cell and size wherever it is shown, and kept with the session."""

import json
import queue
from contextlib import closing

import pytest

from app.analysis.black_box.recorder import BlackBoxRecorder
from app.cli import main
from app.estimation.cell_model.cell_file import load_cell
from app.service.events import Events
from app.service.trip_explanation import TripExplanation
from app.sessions.catalogue import Catalogue
from app.sessions.event_log import EventLog
from tests.fake_clock import FunctionClock
from tests.recorded.scenario import CELL, EPOCH_NS, ScenarioRecorder

JOINT, MORE_MOHM = 63, 14.0


class Car(ScenarioRecorder):
    """A recorded car with the black box and the explanation of trips that the service has."""

    def __init__(self, folder, scenario):
        super().__init__(folder / "sessions", scenario)
        clock = FunctionClock(lambda: self.now_ns, lambda: EPOCH_NS + self.now_ns)
        events = Events(EventLog(folder / "events.sqlite", clock), clock)
        events.subscribe(lambda event: self.recorder.event(self.now_ns, event))
        catalogue = Catalogue(folder / "sessions")
        explanation = TripExplanation(self.recorder, catalogue, self.pipeline, load_cell(CELL), events, clock)
        self.made = queue.SimpleQueue()

        def on_made(box):
            explanation.on_black_box(box)
            self.made.put(box)

        self.boxes = BlackBoxRecorder(
            folder / "blackboxes.sqlite", lambda: self.info.id, on_made, explanation.cause, is_simulated=False
        )
        self.store = events.store

    def _record(self, output):
        super()._record(output)
        if hasattr(self, "boxes"):
            self.boxes.on_output(output, self.now_ns)

    def close(self):
        self.boxes.close()
        self.store.close()
        super().close()


def shown(cause):
    """Return what has to be the same everywhere of a cause as JSON."""
    return cause["code"], cause["cell"], cause["size"], cause["low"], cause["high"], cause["unit"], cause["judged"]


@pytest.fixture(scope="module")
def tripped(tmp_path_factory):
    """A data folder with a joint's trip in it, and what the live page showed at its end."""
    folder = tmp_path_factory.mktemp("tripped")
    with closing(Car(folder, "clean-endurance")) as car:
        car.run(60.0)
        car.player.faults.inject("joint-resistance-high", JOINT, MORE_MOHM)
        car.run(30.0)
        car.made.get(timeout=60)
        car.run(20.0)
        snapshot, session_id = car.snapshot, car.info.id
    return folder, session_id, snapshot


def command(capsys, folder, *words):
    """Run a command on the data folder and return what it prints as JSON."""
    capsys.readouterr()
    assert main(("sessions", *words, "--data", str(folder), "--json")) == 0
    return json.loads(capsys.readouterr().out)


def test_banner_cell_page_black_box_report_and_command_line_agree(make_client, tripped, capsys):
    folder, session_id, snapshot = tripped
    client = make_client(data=folder)
    trip = next(each for each in snapshot.alarms if each.severity == "trip")
    banner = json.loads(
        json.dumps(
            {name: getattr(trip.cause, name) for name in ("code", "cell", "size", "low", "high", "unit", "judged")}
        )
    )
    assert (banner["code"], banner["cell"]) == ("joint-resistance-high", JOINT)
    page = [each for each in snapshot.findings if each.cell == JOINT]
    assert [(each.code, each.size, each.low, each.high) for each in page] == [
        (banner["code"], banner["size"], banner["low"], banner["high"])
    ]
    listed = client.get(f"/api/v1/sessions/{session_id}/blackboxes").json()["boxes"]
    boxes = [client.get(f"/api/v1/blackboxes/{each['id']}").json() for each in listed]
    box = next(each for each in boxes if each["severity"] == "trip")
    report = client.get(f"/api/v1/sessions/{session_id}/report").json()
    printed = next(each for each in command(capsys, folder, "blackbox", session_id) if each["severity"] == "trip")
    reported = command(capsys, folder, "report", session_id)
    found = [banner, box["cause"], report["causes"][0], printed["cause"], reported["causes"][0]]
    assert {shown(each) for each in found} == {shown(banner)}
    assert printed == box
