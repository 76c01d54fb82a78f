from dataclasses import replace

from app.estimation.health.cell_finding import CellFinding
from app.live.alarms import FindingChanges
from app.live.pipeline_factory import PipelineFactory
from app.telemetry.cell_findings import finding_of
from app.words import render

NAN = float("nan")


def found(code, cell, size, unit="ohm", value=0.016):
    neighbours = (cell - 1, cell + 1)
    return finding_of(
        CellFinding(code, cell, size, 1e-3, unit, 1e9, 1e9 + 5, 25.0, 50.0, value, 0.002, neighbours, 0.99)
    )


def snapshot(*findings):
    pipeline = PipelineFactory("coulomb", "samsung-25r-10p").pipeline("serial")
    return replace(pipeline.tick(10**9, 2 * 10**18).snapshot, findings=findings)


def test_a_finding_is_an_event_once_and_another_when_it_ends():
    news, joint = FindingChanges(), found("joint-resistance-high", 63, 14e-3)
    (event,) = news.step(snapshot(joint))
    assert (event.code, event.cell, event.value, event.unit) == ("finding-joint-resistance-high", 63, 14e-3, "ohm")
    assert "pack 6, cell 4" in render(event.message, [12] * 8)
    assert "14.00 mΩ" in render(event.message, [12] * 8)
    assert news.step(snapshot(found("joint-resistance-high", 63, 14.2e-3))) == []
    (ended,) = news.step(snapshot())
    assert (ended.code, ended.severity, ended.cell) == ("finding-ended", "info", 63)


def test_every_cell_is_an_event_of_its_own():
    cells = [3, 40, 63]
    events = FindingChanges().step(snapshot(*(found("self-discharge-high", cell, 0.02, "A") for cell in cells)))
    assert [event.cell for event in events] == cells
