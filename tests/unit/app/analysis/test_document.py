import json

import pytest

from app.analysis import document as module
from app.analysis.black_box.from_session import black_boxes
from app.analysis.document import SLOT, NotBuilt, document
from app.sessions.reading.reader import SessionFile


@pytest.fixture
def box(make_session):
    event = {"at_s": 3.0, "severity": "trip", "code": "trip-slave-lost", "text": "</script><b>slave"}
    with SessionFile(make_session([], [], events=[event])) as session:
        return black_boxes(session)[0]


def test_the_data_stands_in_its_slot_and_cannot_end_it(box, tmp_path, monkeypatch):
    page = tmp_path / "document.html"
    page.write_text(f"<html>{SLOT}</script><p>after</p></html>")
    monkeypatch.setattr(module, "TEMPLATE", page)
    made = document(box, "nb")
    body, after = made.split(SLOT)[1].split("</script>", 1)
    assert after == "<p>after</p></html>"
    assert json.loads(body)["data"]["message"]["text"] == "</script><b>slave"
    assert json.loads(body)["language"] == "nb"


def test_a_page_that_was_not_built_is_said_so(box, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "TEMPLATE", tmp_path / "none.html")
    with pytest.raises(NotBuilt, match="make frontend"):
        document(box)
