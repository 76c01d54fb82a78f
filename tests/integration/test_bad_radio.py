"""A recorder is followed over a radio that loses, is late and is cut while it records: nothing is lost.

The service follows itself through the radio: it is the recorder in the car, and the pit that copies it.
"""

import socket
import time
from contextlib import closing

import pytest

from app.sessions.reading.reader import SessionFile
from tests.bad_radio import BadRadio
from tests.campaign import SIZE, campaign, of_size, report_figure
from tests.service_process import WAIT_S, until

LATENCY_S = {"sample": 0.02, "short": 0.2, "full": 0.5, "long": 1.0}[SIZE]  # each way
CUT_S = of_size(0, 10, 30, 120)
PATIENCE_S = of_size(2 * WAIT_S, 300, 1500)  # a piece is closed after ten seconds, and asked for after more
pytestmark = campaign(240, 600, 3600)


@pytest.fixture
def radio():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with closing(BadRadio(("127.0.0.1", port), latency_s=LATENCY_S, loss=0.3, seed=3)) as radio:
        radio.target_port = port
        yield radio


def test_a_session_that_was_recorded_while_the_radio_was_cut_is_whole_in_the_end(radio, make_service):
    recorder = ("--recorder", f"car={radio.url}", "--recorder-order", "newest")
    service = make_service("--seed", "1", "--port", str(radio.target_port), *recorder)
    with service.client() as client:

        def told() -> dict:
            return client.get("/copies").json()

        def sessions() -> dict[str, dict]:
            return {each["id"]: each for each in client.get("/sessions").json()["sessions"]}

        assert [client.put("/copies/order", json={"order": each}).json()["order"] for each in ("oldest", "newest")] == [
            "oldest",
            "newest",
        ]
        until(lambda: any(copy["pieces"] and copy["missing_s"] == 0 for copy in told()["copies"]), PATIENCE_S)
        assert told()["recorders"] == [
            {"url": radio.url, "is_reached": True, "error": None}
            | {"last_contact_s": told()["recorders"][0]["last_contact_s"]}
        ]
        (copy,) = told()["copies"]
        session_id = copy["id"].removeprefix("car-")
        assert copy["recording"]
        assert copy["id"] not in sessions()
        radio.cut()
        until(lambda: not told()["recorders"][0]["is_reached"], PATIENCE_S)
        time.sleep(CUT_S)
        assert told()["recorders"][0]["error"]
        client.post(f"/sessions/{session_id}/stop")
        until(lambda: sessions()[session_id]["closed"])
        radio.repair()
        until(
            lambda: copy["id"] in sessions() and copy["id"] not in {each["id"] for each in told()["copies"]}, PATIENCE_S
        )
    folder = service.data / "sessions"
    with SessionFile(folder / f"{session_id}.sqlite") as there, SessionFile(folder / f"{copy['id']}.sqlite") as here:
        assert list(here.frames()) == list(there.frames())
        assert list(here.can_frames()) == list(there.can_frames())
        assert (here.info.is_closed, here.info.frames, here.problems()) == (True, there.info.frames, [])
        assert here.events() == there.events()
        report_figure(
            f"bad radio: 30 % lost, {LATENCY_S:g} s each way, cut for {CUT_S} s: {here.info.frames} of"
            f" {there.info.frames} frames and {here.info.can_frames} of {there.info.can_frames} CAN frames here"
        )
