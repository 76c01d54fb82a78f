"""The page's types and its fixtures say what the service really answers."""

import importlib.util
import re
from pathlib import Path

import pytest

FRONTEND = Path(__file__).resolve().parents[2] / "frontend"
TYPES = (FRONTEND / "src" / "link" / "types.ts").read_text()


def members(interface: str) -> set[str]:
    """The members that an interface of types.ts requires."""
    body = re.search(rf"^export interface {interface} \{{\n(.*?)^\}}", TYPES, re.MULTILINE | re.DOTALL)
    assert body is not None, interface
    return set(re.findall(r"^  (\w+):", body[1], re.MULTILINE))


def foretells(snapshot) -> bool:
    """Whether power and times ahead are known already."""
    prediction = snapshot["prediction"]
    return prediction is not None and prediction["power"] is not None and bool(prediction["to_trip"])


@pytest.fixture(scope="module")
def answers(service):
    with service.client() as client:
        client.post("/config/store").raise_for_status()

        def get(path):
            return client.get(path).raise_for_status().json()

        snapshot = service.wait_for(lambda s: s["recording"] is not None and foretells(s))
        schema, tables = get("/config/schema"), get("/can")
        session = get("/sessions")["sessions"][0]
        simulator = get("/simulator")
        series = get(f"/sessions/{session['id']}/series?signal=i_fs&points=10")
        return {
            "Snapshot": snapshot,
            "Cells": snapshot["cells"],
            "Pack": snapshot["packs"][0],
            "Accumulator": snapshot["accumulator"],
            "Prediction": snapshot["prediction"],
            "PowerLimit": snapshot["prediction"]["power"]["discharge"][0],
            "Trip": snapshot["prediction"]["to_trip"][0],
            "Master": snapshot["master"],
            "Charger": snapshot["charger"],
            "Link": snapshot["links"]["can"],
            "Recording": snapshot["recording"],
            "Simulator": simulator,
            "SimulatorStatus": simulator["status"],
            "Scenario": simulator["scenarios"][0],
            "FaultKind": simulator["faults"][0],
            "Me": get("/me"),
            "Health": get("/health"),
            "History": get("/history?seconds=10"),
            "Schema": schema,
            "SchemaField": schema["fields"][0],
            "StructField": schema["struct"][0],
            "Config": get("/config"),
            "StoredConfig": get("/config/stored"),
            "CanTables": tables,
            "CanMessage": tables["tx"][0],
            "CanFrame": get("/can/trace?limit=1")["by_id"][0],
            "Session": session,
            "SessionSeries": series,
            "LogEvent": get("/events?limit=1")["events"][0],
        }


def test_the_service_sends_every_member_that_the_page_reads(answers):
    missing = {name: members(name) - set(answer) for name, answer in answers.items()}
    assert {name: names for name, names in missing.items() if names} == {}


def test_cells_are_arrays_of_96(answers):
    assert {name: len(values) for name, values in answers["Cells"].items() if len(values) != 96} == {}


def test_the_fixtures_know_the_current_memory_map():
    path = FRONTEND / "fixtures" / "make_schema.py"
    spec = importlib.util.spec_from_file_location("make_schema", path)
    make_schema = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make_schema)
    current = (FRONTEND / "fixtures" / "schema.json").read_text()
    assert current == make_schema.text(), "run `PYTHONPATH=. python frontend/fixtures/make_schema.py`"
