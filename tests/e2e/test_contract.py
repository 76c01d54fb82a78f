"""The service answers what its OpenAPI document says, so what the page's generated types say."""

import pytest

from app.api.schemas.config import ConfigOut, StoredConfigOut, WriteResultOut
from app.api.schemas.service import HistoryOut
from app.api.schemas.sessions import SessionSeriesOut
from app.api.schemas.snapshot import SnapshotOut

IS_STORED = True


def foretells(snapshot) -> bool:
    """Whether power and times ahead are known already."""
    prediction = snapshot["prediction"]
    return prediction is not None and prediction["power"] is not None and bool(prediction["to_trip"])


@pytest.fixture(scope="module")
def racing(service):
    with service.client() as client:
        service.wait_for(lambda s: s["recording"] is not None and s["links"]["can"]["frames"] > 0 and foretells(s))
        yield client


@pytest.mark.parametrize(
    ("path", "shape"),
    [
        ("/snapshot", SnapshotOut),
        ("/history?seconds=10", HistoryOut),
        ("/history?seconds=10&cell=17", HistoryOut),
        ("/config", ConfigOut),
        ("/config/stored", StoredConfigOut),
    ],
)
def test_an_answer_has_the_documented_members_and_no_other(racing, path, shape):
    text = racing.get(path).raise_for_status().text
    shape.model_validate_json(text, strict=True, extra="forbid")


def test_a_series_has_the_documented_members_and_no_other(racing):
    session = racing.get("/sessions").json()["sessions"][0]["id"]
    answer = racing.get(f"/sessions/{session}/series?signal=i_fs&signal=v[36]&points=10").raise_for_status()
    SessionSeriesOut.model_validate_json(answer.text, strict=True, extra="forbid")


def test_a_difference_has_the_documented_members_and_no_other(racing):
    etag = racing.get("/config").headers["etag"]
    answer = racing.put(
        "/config?dry_run=true", json={"values": {"telemetry_period": 120}}, headers={"If-Match": etag}
    ).raise_for_status()
    found = WriteResultOut.model_validate_json(answer.text, strict=True, extra="forbid")
    assert [change.field for change in found.difference] == ["telemetry_period"]


def test_cells_are_arrays_of_96(racing):
    cells = racing.get("/snapshot").json()["cells"]
    assert {name: len(values) for name, values in cells.items() if len(values) != 96} == {}
