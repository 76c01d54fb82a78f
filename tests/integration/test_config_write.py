"""A configuration write in a real service, over a pseudo-terminal, to the simulated car: whom it passes and awaits."""

import os
import sys
import threading
from pathlib import Path

import orjson
import pytest
from starlette.requests import Request

import app
import firmware_protocol
from app.api.configuration import routes
from app.api.web.authentication import User
from app.clock import Clock
from app.service.settings import Settings
from app.service.wiring import make_service
from app.sources.items import CanItem
from firmware_protocol.config_image import unit_value
from tests.service_process import until

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")

OURS = tuple(str(Path(package.__file__).parent) for package in (app, firmware_protocol))


@pytest.fixture
def service(simulator, tmp_path):
    port = tmp_path / "port"
    simulator("--serial", f"pty:{port}", "--scenario", "in-the-pit")
    settings = Settings(data=tmp_path / "data", record=False)
    made = make_service(settings, Clock(), source="serial", serial_url=str(port), can_url=None)
    made.start()
    until(lambda: made.links.master.identity is not None and made.configuration.in_force.image() is not None)
    yield made
    made.stop()


def put(service, values):
    answer = routes.write(
        body=orjson.dumps({"values": values, "reason": "a test"}),
        configuration=service.configuration.writer,
        config_sources=service.configuration.sources,
        user=User("ada", "engineer"),
        request=Request({"type": "http", "headers": []}),
        expected="*",
    )
    return orjson.loads(answer.body)


def test_a_write_finishes_while_the_pipeline_stands_still(service):
    stalled, released = threading.Event(), threading.Event()

    def stall(item):
        stalled.set()
        released.wait(60)

    service.live._on_item = (stall,)
    try:
        assert stalled.wait(30)
        for number in range(5000):  # a busy CAN bus fills the inbox
            service.live._inbox.put(CanItem(number, number, 0x123, bytes(8)))
        answer = put(service, {"telemetry_period": 110})
        assert (answer["written"], answer["verified"]) == (True, True)
        assert unit_value(service.configuration.in_force.image(), "telemetry_period") == 110
        assert service.configuration.writer.store("ada").counter == 1
        assert service.links.master.identify().is_compatible
        assert not released.is_set(), "all of it while one item stood in the pipeline"
    finally:
        released.set()


CHECKS = {  # what a write reads, compares, reviews and logs on the way, and what time it is
    *("ConfigurationWriter.read", "Draft.applied_to", "image_hash", "Rules.context", "review_change", "difference"),
    *("ConfigurationWriter._require_same_map", "ConfigurationWriter._require_rest", "WriteLog.begun"),
    *("ConfigIssue.blocks", "ConfigIssue.needs_reason", "Clock.monotonic_s"),
}


def test_a_draft_passes_at_most_twelve_functions_from_the_route_to_the_port(service):
    passed: list[str] = []
    checking: list[object] = []
    is_sent = False

    def profile(frame, event, argument):
        nonlocal is_sent
        code = frame.f_code
        if is_sent or code.co_name.startswith("<") or not code.co_filename.startswith(OURS):
            return
        if event == "return" and checking and checking[-1] is frame:
            checking.pop()
        elif event == "call" and not checking:
            if code.co_qualname in CHECKS:
                checking.append(frame)
            elif code.co_qualname not in passed:
                passed.append(code.co_qualname)
        elif event == "return" and not checking and code.co_qualname == "SerialLink.write":
            is_sent = True

    sys.setprofile(profile)
    try:
        put(service, {"telemetry_period": 120})
    finally:
        sys.setprofile(None)
    assert is_sent
    assert (passed[0], passed[-1]) == ("write", "SerialLink.write")
    assert len(passed) <= 12, " ".join(passed)
