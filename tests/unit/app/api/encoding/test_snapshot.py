import json

import numpy as np
import pytest

from app.api.encoding.encoder import snapshot_json
from app.api.schemas.snapshot import SnapshotOut
from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import make_estimator
from app.live.pipeline import Pipeline
from app.sources.master.source import MasterSource
from app.telemetry.service_state import ServiceState

CELL = load_cell("samsung-25r-10p")
SERVICE = ServiceState(None, None, 3, None)


@pytest.fixture
def pipeline():
    return Pipeline(MasterSource("serial"), lambda: make_estimator("coulomb", CELL, 96), filter_name="c", cell_name="c")


def encoded(snapshot):
    body = json.loads(snapshot_json(snapshot, SERVICE), parse_constant=lambda name: pytest.fail(name))
    SnapshotOut.model_validate(body)
    return body


def test_missing_is_null_and_never_zero(pipeline, master):
    master.set("v", [0, *[37000] * 95])
    body = encoded(pipeline.feed(master.frame()).snapshot)
    assert body["cells"]["voltage_v"][:2] == [None, 3.7]
    assert body["packs"][0]["voltage_v"] is None
    assert body["cells"]["balancing"] == [None] * 96
    nothing = encoded(Pipeline(MasterSource("can"), lambda: None, filter_name="c", cell_name="c").tick(1, 1).snapshot)
    assert nothing["age"]["voltage"] is None
    assert nothing["master"]["flags"] is None


def test_no_number_is_not_a_number(pipeline, master):
    snapshot = pipeline.feed(master.frame()).snapshot
    snapshot.cells.residual_v[:3] = np.inf, -np.inf, np.nan
    assert encoded(snapshot)["cells"]["residual_v"][:3] == [None] * 3


def test_the_services_part_is_merged_in(pipeline, master):
    assert encoded(pipeline.feed(master.frame()).snapshot)["last_event_id"] == 3


def test_what_can_does_not_tell_is_not_zero(pipeline, master):
    links = encoded(pipeline.feed(master.frame()).snapshot)["links"]
    assert links["can"]["crc_errors"] is None
    assert links["rs232"]["crc_errors"] == 0
