"""A joint of 14 mohm more at pack 6, cell 4: from injection to alarm, event, session, restart, report, black box."""

import pytest

from app.analysis.black_box.from_session import black_boxes
from app.analysis.report.report import report_of
from app.analysis.root_cause.from_session import causes_of
from app.live.learned_state import LearnedState, load_learned_state, save_learned_state
from app.live.prediction import Predictor
from app.sessions.reading.reader import SessionFile
from tests.campaign import SIZE, campaign
from tests.recorded.scenario import ScenarioRecorder

CELL, MORE_MOHM = 63, 14.0
DRIVEN_MOHM = 5.0  # 14 mohm open the shutdown circuit within half a second of full power: too little to learn from
PLACE = "ack 6, cell 4"
DRIVEN_S = 120.0  # for the regression to know the resistances, on a busy machine


@pytest.mark.timeout(300)
def test_a_joint_that_parts_is_named_from_injection_to_report(tmp_path):
    car = ScenarioRecorder(tmp_path, "clean-endurance")
    car.run(60.0)
    assert car.snapshot.findings == ()
    car.player.faults.inject("joint-resistance-high", CELL, MORE_MOHM)
    car.run(30.0)
    (live,) = car.snapshot.findings
    assert (live.code, live.cell) == ("joint-resistance-high", CELL)
    assert live.low <= 1e-3 * MORE_MOHM <= live.high
    alarm = next(each for each in car.snapshot.alarms if each.code == "joint-resistance-high")
    assert alarm.cell == CELL

    car.run(75.0)
    (stood,) = car.snapshot.findings
    assert stood.size == live.size
    assert stood.seen - live.seen < 10.0
    assert car.snapshot.cells.joint_excess_ohm[CELL] > 0.012
    assert car.snapshot.estimator.resistance_age_s > 60.0

    predictor = car.predictor
    save_learned_state(tmp_path / "past.npz", LearnedState(car.pipeline.charge, predictor.learned_cells))
    again = Predictor(predictor.cell, (12,) * 8, load_learned_state(tmp_path / "past.npz", 96).cells)
    assert [(each.code, each.cell, each.size) for each in again.findings] == [
        ("joint-resistance-high", CELL, live.size)
    ]

    car.close()
    with SessionFile(car.info.path) as session:
        told = [event for event in session.events() if event["code"] == "finding-joint-resistance-high"]
        assert [event["cell"] for event in told] == [CELL]
        assert [(cause.code, cause.cell) for cause in causes_of(session)][:1] == [("joint-resistance-high", CELL)]
        report = report_of(session)
        assert f"high-resistance busbar joint at p{PLACE}" in report.findings.why[0].text
        assert any(f"P{PLACE}: busbar joint resistance +" in each.text for each in report.findings.why)
        assert not any("like the others" in each.text for each in report.findings.why)
        box = next(each for each in black_boxes(session) if each.severity == "trip")
        assert any(PLACE in each.text and "joint resistance +" in each.text for each in box.findings)


@campaign(400, 400, 400)
@pytest.mark.skipif(SIZE == "sample", reason="a minute of driving in real time: in the campaign")
def test_the_service_shows_a_joint_that_parts_and_keeps_it_while_the_car_stands(make_service):
    service = make_service("--seed", "1", "--scenario", "race-day")
    service.wait_for(lambda s: s["cells"]["joint_excess_ohm"][CELL] is not None, seconds=DRIVEN_S)
    with service.client() as client:
        fault = {"fault": "joint-resistance-high", "pack": 6, "cell": 4, "value": DRIVEN_MOHM}
        assert client.post("/simulator/faults", json=fault).status_code == 201
        found = service.wait_for(lambda s: s["findings"], seconds=DRIVEN_S)["findings"][0]
        assert (found["code"], found["cell"], found["unit"]) == ("joint-resistance-high", CELL, "ohm")
        assert PLACE in found["message"]["text"]
        alarmed = service.wait_for(lambda s: any(alarm["code"] == "joint-resistance-high" for alarm in s["alarms"]))
        assert next(alarm for alarm in alarmed["alarms"] if alarm["code"] == "joint-resistance-high")["cells"] == [CELL]
        excess_ohm = alarmed["cells"]["joint_excess_ohm"][CELL]
        assert excess_ohm == pytest.approx(1e-3 * DRIVEN_MOHM, rel=0.3)
        assert client.post("/simulator/faults", json=fault | {"value": MORE_MOHM}).status_code == 201
        stood = service.wait_for(lambda s: (s["estimator"]["resistance_age_s"] or 0) > 15, seconds=DRIVEN_S)
        assert [(each["code"], each["cell"]) for each in stood["findings"]] == [("joint-resistance-high", CELL)]
        assert stood["cells"]["joint_excess_ohm"][CELL] > 0.7e-3 * DRIVEN_MOHM
        events = client.get("/events").json()
    assert "finding-joint-resistance-high" in str(events)
