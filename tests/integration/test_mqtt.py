"""What the service publishes through a real broker: plain, with a password, over TLS, killed and restarted."""

import json
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import paho.mqtt.client as paho
import pytest

from app.clock import Clock
from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import make_estimator
from app.live.pipeline import Pipeline
from app.live.pipeline_factory import PipelineFactory
from app.service.mqtt.broker import parse_broker
from app.service.mqtt.publisher import MqttPublisher
from app.sources.items import CanItem, LinkChange
from app.sources.loaded_battery import load_battery
from app.sources.master.source import MasterSource
from app.telemetry import Event
from app.telemetry.service_state import RecordingState
from app.words import Message, render
from tests.mosquitto import IS_CI, MOSQUITTO, Mosquitto
from tests.peer_batteries import one_signal_a_cell
from tests.recorded.peer_sessions import write_profile
from tests.unit.app.conftest import FakeMaster

pytestmark = pytest.mark.skipif(MOSQUITTO is None and not IS_CI, reason="no mosquitto: apt-get install mosquitto")


class Listener:
    """Subscribes to everything below a prefix and keeps the newest of each topic."""

    def __init__(self, port: int, *, ca: Path | None = None, user: tuple[str, str] | None = None) -> None:
        self.received: dict[str, tuple[bytes, bool]] = {}
        self.events: list[dict[str, Any]] = []
        self._news = threading.Condition()
        self._client = paho.Client(paho.CallbackAPIVersion.VERSION2)
        if ca is not None:
            self._client.tls_set(str(ca))
        if user is not None:
            self._client.username_pw_set(*user)
        self._client.on_connect = lambda client, *_: client.subscribe("#", qos=1)
        self._client.on_message = self._on_message
        self._client.reconnect_delay_set(0.05, 0.05)
        self._client.connect("127.0.0.1", port)
        self._client.loop_start()

    def _on_message(self, _client: object, _data: object, message: Any) -> None:
        with self._news:
            self.received[message.topic] = (message.payload, message.retain)
            if message.topic.endswith("/events"):
                self.events.append(json.loads(message.payload))
            self._news.notify_all()

    def wait(self, until: Callable[["Listener"], object], timeout_s: float = 20) -> None:
        with self._news:
            assert self._news.wait_for(lambda: until(self), timeout_s), {t: p[0][:80] for t, p in self.received.items()}

    def json(self, topic: str) -> Any:
        return json.loads(self.received[topic][0])

    def close(self) -> None:
        self._client.disconnect()
        self._client.loop_stop()


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Mosquitto]:
    running = Mosquitto(tmp_path).start()
    yield running
    running.kill()


@pytest.fixture
def closing() -> Iterator[Callable[[Any], Any]]:
    """Closes what it was given, at the end."""
    opened: list[Any] = []

    def keep(each: Any) -> Any:
        opened.append(each)
        return each

    yield keep
    for each in reversed(opened):
        (each.stop if isinstance(each, MqttPublisher) else each.close)()


RECORDING = RecordingState("s1", since_ns=0, frames=1, bytes=0)


def problem_of(sender: MqttPublisher) -> str:
    return "" if sender.problem is None else render(sender.problem)


def publisher(url: str, **more: Any) -> MqttPublisher:
    made = MqttPublisher(parse_broker(url, **more), lambda: RECORDING, Clock(), period_s=0.05)
    made.start()
    return made


@pytest.fixture
def snapshots() -> Callable[[], Any]:
    """Snapshots of a master whose current grows; cell 5 is not measured."""
    cell = load_cell("samsung-25r-10p")
    pipeline = Pipeline(
        MasterSource("serial", "there"),
        lambda: make_estimator("coulomb", cell, 96),
        filter_name="c",
        cell_name="c",
    )
    pipeline.feed(LinkChange(1, 1, "rs232", "open"))
    master = FakeMaster()
    master.set("v", [0 if i == 5 else 37000 + i for i in range(96)])

    def make(silent_s: int = 0) -> Any:
        t_ns = master.t_ns + silent_s * 10**9
        return (pipeline.tick(t_ns, t_ns) if silent_s else pipeline.feed(master.frame())).snapshot

    return make


def test_state_is_retained_and_complete(broker, closing, snapshots):
    sender = closing(publisher(f"mqtt://127.0.0.1:{broker.port}/pit"))
    first = closing(Listener(broker.port))
    first.wait(lambda x: x.received.get("pit/status", (b"",))[0] == b"online")
    sender.offer(snapshots())
    first.wait(lambda x: "pit/recording" in x.received)
    late = closing(Listener(broker.port))
    late.wait(lambda x: len(x.received) >= 10)
    assert all(retained for _, retained in late.received.values())
    assert late.json("pit/accumulator")["current_a"] == pytest.approx(10.0)
    values = late.json("pit/cells/voltage_v")["values"]
    assert (len(values), values[5], values[6]) == (96, None, pytest.approx(3.7006))
    assert late.json("pit/cells/soc")["values"][0] > 0
    assert late.json("pit/master")["fit"] is True
    assert late.json("pit/links")["rs232"]["state"] == "live"
    assert late.json("pit/alarms") == []
    assert late.json("pit/recording")["session_id"] == "s1"


def test_of_a_silent_car_the_last_values_are_published_next_to_null(broker, closing, snapshots):
    sender = closing(publisher(f"mqtt://127.0.0.1:{broker.port}/pit"))
    listener = closing(Listener(broker.port))
    sender.offer(snapshots())
    listener.wait(lambda x: "pit/cells/voltage_v" in x.received)
    assert (listener.json("pit/cells/voltage_v")["last_known"], listener.json("pit/accumulator")["last_known"]) == (
        None,
        None,
    )
    sender.offer(snapshots(60))
    listener.wait(lambda x: x.json("pit/accumulator")["last_known"] and x.json("pit/cells/voltage_v")["last_known"])
    volts, total = listener.json("pit/cells/voltage_v"), listener.json("pit/accumulator")
    assert volts["values"] == [None] * 96
    assert volts["last_known"]["values"][5:7] == [None, pytest.approx(3.7006)]  # cell 5 was never measured
    assert volts["time"] - volts["last_known"]["time"] == pytest.approx(60, abs=0.1)
    assert (total["current_a"], total["last_known"]["current_a"]["value"]) == (None, pytest.approx(10.0))


def test_216_cells_of_a_battery_by_dbc_are_published_whole(broker, closing, tmp_path):
    peer = one_signal_a_cell(216, 108, "V{}", "T{}", 0.0001, "V")
    pipeline = PipelineFactory("coulomb", None, load_battery(str(write_profile(peer, tmp_path)))).pipeline("can")
    outputs = [pipeline.feed(CanItem(t_ns, 10**18 + t_ns, can_id, data)) for t_ns, can_id, data in peer.frames(2)]
    newest = next(output.snapshot for output in reversed(outputs) if output.snapshot is not None)
    sender = closing(publisher(f"mqtt://127.0.0.1:{broker.port}"))
    listener = closing(Listener(broker.port))
    sender.offer(newest)
    topics = {f"voltwall/cells/{name}" for name in ("voltage_v", "temperature_degc", "soc", "soc_sigma")}
    listener.wait(lambda x: topics <= x.received.keys())
    told = {topic: listener.json(topic)["values"] for topic in topics}
    assert {len(values) for values in told.values()} == {216}
    assert told["voltwall/cells/voltage_v"] == pytest.approx(newest.cells.voltage_v.tolist(), abs=1e-4)
    assert None not in told["voltwall/cells/temperature_degc"]
    assert listener.json("voltwall/accumulator")["loaded_cells"] == 216


def test_events_are_published_as_they_happen_and_not_retained(broker, closing):
    listener = closing(Listener(broker.port))
    sender = closing(publisher(f"mqtt://127.0.0.1:{broker.port}"))
    sender.offer_event(
        Event(
            10**18,
            "trip",
            "cell-overtemperature",
            Message("cell-overtemperature"),
            cell=7,
            value=61.0,
            limit=60.0,
            unit="degC",
        )
    )
    listener.wait(lambda x: x.events)
    assert listener.events[0] == {
        "time": 1e9, "severity": "trip", "code": "cell-overtemperature", "cell": 7, "value": 61.0,
        "message": {"code": "cell-overtemperature", "args": {}, "text": "cell overtemperature"},
        "limit": 60.0, "unit": "degC", "who": None, "simulated": False,
    }  # fmt: skip
    late = closing(Listener(broker.port))
    late.wait(lambda x: "voltwall/status" in x.received)
    assert late.events == []


def test_a_broker_that_dies_and_comes_back_has_everything_again(broker, closing, snapshots):
    sender = closing(publisher(f"mqtt://127.0.0.1:{broker.port}"))
    listener = closing(Listener(broker.port))
    sender.offer(snapshots())
    listener.wait(lambda x: "voltwall/accumulator" in x.received)
    broker.kill()
    while sender.problem is None:
        time.sleep(0.01)
    sender.offer_event(Event(1, "info", "while-away", Message("verbatim", text="kept")))
    listener.received.clear()
    broker.start()
    listener.wait(lambda x: x.received.get("voltwall/status", (b"",))[0] == b"online")
    sender.offer(replace(snapshots(), source="serial"))
    listener.wait(lambda x: {"voltwall/accumulator", "voltwall/alarms", "voltwall/cells/soc"} <= x.received.keys())
    listener.wait(lambda x: [event["code"] for event in x.events] == ["while-away"])
    assert sender.problem is None


def test_the_broker_says_offline_for_a_service_that_is_gone(broker, closing):
    listener = closing(Listener(broker.port))
    sender = publisher(f"mqtt://127.0.0.1:{broker.port}")
    listener.wait(lambda x: x.received.get("voltwall/status", (b"",))[0] == b"online")
    sender.stop()
    listener.wait(lambda x: x.received["voltwall/status"][0] == b"offline")
    code = f"""
import os, time
from app.clock import Clock
from app.service.mqtt.broker import parse_broker
from app.service.mqtt.publisher import MqttPublisher
sender = MqttPublisher(parse_broker("mqtt://127.0.0.1:{broker.port}/killed"), lambda: None, Clock())
sender.start()
while sender.problem:
    time.sleep(0.01)
time.sleep(0.2)
os.kill(os.getpid(), 9)
"""
    subprocess.run([sys.executable, "-c", code], check=False, timeout=30)
    listener.wait(lambda x: x.received.get("killed/status", (b"",))[0] == b"offline", 30)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # paho drops sockets it was refused on
def test_tls_with_a_password(tmp_path, closing, snapshots):
    key, certificate, passwords = tmp_path / "key.pem", tmp_path / "cert.pem", tmp_path / "passwords"
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "2",
         "-subj", "/CN=pit", "-addext", "subjectAltName=IP:127.0.0.1", "-keyout", key, "-out", certificate],
        check=True, capture_output=True,
    )  # fmt: skip
    passwords.touch(mode=0o600)
    hasher = shutil.which("mosquitto_passwd") or "/usr/bin/mosquitto_passwd"
    subprocess.run([hasher, "-b", passwords, "pit", "secret"], check=True, capture_output=True)
    tls = f"certfile {certificate}\nkeyfile {key}\npassword_file {passwords}"
    broker = Mosquitto(tmp_path, tls).start()
    try:
        url = f"mqtts://pit@127.0.0.1:{broker.port}"
        sender = closing(publisher(url, password="secret", ca=certificate))
        listener = closing(Listener(broker.port, ca=certificate, user=("pit", "secret")))
        sender.offer(snapshots())
        listener.wait(lambda x: "voltwall/accumulator" in x.received)
        wrong = closing(publisher(url, password="guess", ca=certificate))
        stranger = closing(publisher(url, password="secret"))
        deadline = time.monotonic() + 15
        while "authori" not in problem_of(wrong).lower() and time.monotonic() < deadline:
            time.sleep(0.02)
        assert "authori" in problem_of(wrong).lower()
        assert stranger.problem is not None
        assert "secret" not in problem_of(stranger)
    finally:
        broker.kill()
