"""The test of a port and of an adapter over HTTP, on simulated batteries behind pseudo-terminals."""

import os
import re
import sys
from pathlib import Path

import pytest

from tests.forked import PLUGGED
from tests.service_process import Service, until
from tests.simulator_port import Simulator

BUNDLED = Path(__file__).resolve().parents[2] / "app" / "battery" / "bundled"
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")


@pytest.fixture
def plugged(tmp_path):
    """Start a service that finds a serial port and an adapter, and a function that starts what is on them."""
    serial, can = str(tmp_path / "ttyUSB0"), str(tmp_path / "ttyACM0")
    service = Service(tmp_path / "data", [], {PLUGGED: os.pathsep.join((serial, can))})
    started = []

    def simulate(*arguments):
        started.append(Simulator(["simulate", *arguments], program="app.cli").start())
        return started[-1]

    yield service, simulate, serial, f"slcan:{can}?sleep_after_open=0"
    if service.process is not None:
        service.stop()  # before the terminals close
    for each in started:
        each.stop()


def check(service, **link):
    with service.client() as client:
        answer = client.post("/setup/check-link", json=link)
        assert answer.status_code == 200, answer.text
        return answer.json()


def orion_on(simulate, can, *more):
    port = can.removeprefix("slcan:").partition("?")[0]
    return simulate("--battery", "orion-bms-2", "--can", f"slcan-pty:{port}", "--bit-rate", "250000", *more)


def test_a_bus_at_another_rate_is_found_by_listening_and_its_battery_recognised(plugged):
    service, simulate, _, can = plugged
    orion_on(simulate, can)
    service.start()
    found = check(service, can=can)
    assert [(each["setting"], each["frames"] > 0) for each in found["trials"]] == [
        ("500 kbit/s", False),
        ("250 kbit/s", True),
    ]
    assert found["url"] == f"{can}&bitrate=250000"
    assert found["recognised"] == [{"id": "orion-bms-2", "name": "Orion BMS 2, 72 cells", "is_part": False}]
    assert found["rate_hz"] == pytest.approx(found["frames"] / found["seconds"], rel=0.1)
    assert found["advice"] is None
    service.choose(battery="orion-bms-2", can=found["url"])
    service.wait_for(lambda each: each["links"]["can"]["url"] == found["url"] and each["links"]["can"]["frames"] > 0)


def test_a_battery_that_is_alone_is_found_once_the_adapter_may_acknowledge(plugged):
    service, simulate, _, can = plugged
    orion_on(simulate, can, "--alone")
    service.start()
    found = check(service, can=can)
    assert found["frames"] == 0
    assert found["advice"]["code"] == "advice-can-unacknowledged"
    assert len(found["trials"]) == 4
    found = check(service, can=can, is_alone=True)
    assert found["frames"] > 0
    assert found["url"] == f"{can}&bitrate=250000"


def test_a_serial_line_of_another_battery_is_recognised_and_its_frames_counted(plugged):
    service, simulate, serial, _ = plugged
    simulate("--battery", "jbd", "--serial", f"pty:{serial}")
    service.start()
    found = check(service, serial=serial, battery="team")
    assert found["frames"] > 0
    assert [each["id"] for each in found["recognised"]] == ["jbd"]
    assert found["has_checksum"]
    assert found["trials"][0] == {
        "setting": "115200 8E1", "bytes": 0, "frames": 0, "errors": None, "battery": None,
    }  # fmt: skip


def test_what_is_plugged_in_says_what_it_is(plugged):
    service, _, serial, can = plugged
    service.start()
    with service.client() as client:
        found = client.get("/setup/plugged").json()
    port = next(each for each in found["serial"] if each["url"] == serial)
    assert (port["usb_id"], port["description"]) == ("0403", "FT232R USB UART")
    adapter = next(each for each in found["can"] if each["url"] == can.partition("?")[0])
    assert adapter["listens_only"]


def test_a_round_of_cells_is_recorded_to_its_end_and_can_be_stopped(plugged):
    service, simulate, _, can = plugged
    orion_on(simulate, can, "--speed", "4")  # its round takes 37 s
    service.start()
    files = {"orion.dbc": (BUNDLED / "orion-bms-2.dbc").read_text()}
    with service.client() as client:

        def begin():
            body = {"files": files, "can": f"{can}&bitrate=250000", "seconds": 1}
            return client.post("/setup/profile-drafts", json=body).json()

        draft = begin()
        assert draft["is_recording"]
        draft = client.post(f"/setup/profile-drafts/{draft['id']}", json={"stops": True}).json()
        assert not draft["is_recording"]
        stopped_s = draft["recorded_s"]
        frames = draft["frames"]
        assert client.post(f"/setup/profile-drafts/{draft['id']}", json={}).json()["frames"] == frames
        draft, seen = begin(), []

        def has_ended():
            nonlocal draft
            draft = client.post(f"/setup/profile-drafts/{draft['id']}", json={}).json()
            seen.append(draft["recorded_s"])
            return not draft["is_recording"]

        until(has_ended, 60)
    assert stopped_s < seen[-1] < draft["most_s"]
    assert seen == sorted(seen)
    assert draft["cells"] == 72
    assert "infer-round-not-complete" not in [each["code"] for each in draft["questions"]]


def test_an_adapter_that_is_missing_is_named_and_its_drivers_do_not_flood_the_terminal(plugged):
    service = plugged[0]
    missing = "slcan:/dev/ttyACM77?sleep_after_open=0"
    service.arguments = ["--battery", "orion-bms-2", "--can", missing]
    service.start()
    lost = service.wait_for(lambda each: each["links"]["can"]["state"] == "lost")
    assert missing in lost["links"]["can"]["error"]["text"]
    with service.client() as client:
        for _ in range(4):
            assert client.get("/setup/plugged").status_code == 200
            assert (
                missing
                in client.post("/setup/check-link", json={"can": f"{missing}&timeout=1"}).json()["error"]["text"]
            )
    of_drivers = [each.split(maxsplit=2)[-1] for each in service.lines if re.search(r" can(\.|:)", each)]
    assert len(of_drivers) == len(set(of_drivers)), "each once"
