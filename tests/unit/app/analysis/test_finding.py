import json
from dataclasses import asdict

from app.analysis.finding import finding, with_cell
from app.words import Cell, Message, Quantity, message_from_json, render


def test_a_finding_is_a_message_in_json_and_a_sentence_in_english():
    message = Message("why-began-lower", cell=Cell(30), below=Quantity(10.0, "%", 0))
    found = finding(message)
    assert found.text == "Pack 3, cell 7 began 10 % below the others and used what they used: balance it."
    assert found.message == message
    stored = json.loads(json.dumps(asdict(found)))
    assert render(message_from_json(stored), "nb").startswith("pakke 3, celle 7 begynte 10 % under")


def test_an_event_is_told_with_its_place_once():
    assert with_cell("slave lost", None) == "slave lost"
    assert with_cell("pack 3, cell 7 too hot", 30) == "pack 3, cell 7 too hot"
    assert (
        finding(Message("report-tripped", event=with_cell("too hot", 30))).text == "Tripped: too hot (pack 3, cell 7)."
    )
