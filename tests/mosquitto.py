"""A real broker for tests."""

import json
import os
import shutil
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

MOSQUITTO = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin:/usr/local/sbin")
VALUES = (  # topics of a car's own values
    *("soc", "soc_min", "soc_min_cell", "voltage_v", "current_a", "voltage_min_v", "voltage_min_cell"),
    *("temperature_max_degc", "temperature_max_cell"),
)
IS_CI = os.environ.get("CI") == "true"  # there a missing broker is a failure


class Mosquitto:
    """A mosquitto on a free port of loopback."""

    def __init__(self, folder: Path, extra: str = "") -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        self._config = folder / "mosquitto.conf"
        anonymous = "false" if "password_file" in extra else "true"
        user = "root" if os.getuid() == 0 else ""
        self._config.write_text(
            f"listener {self.port} 127.0.0.1\nallow_anonymous {anonymous}\n{extra}\n"
            + (f"user {user}\n" if user else "")
        )
        self.process: subprocess.Popen[bytes] | None = None

    def start(self) -> "Mosquitto":
        assert MOSQUITTO is not None, "mosquitto is missing"
        self.process = subprocess.Popen([MOSQUITTO, "-c", str(self._config)], stderr=subprocess.DEVNULL)
        deadline = time.monotonic() + 10
        while True:
            try:
                socket.create_connection(("127.0.0.1", self.port), timeout=1).close()
            except OSError:
                assert time.monotonic() < deadline, "the broker did not start"
                time.sleep(0.02)
            else:
                return self

    def kill(self) -> None:
        if self.process is not None:
            self.process.send_signal(signal.SIGKILL)
            self.process.wait()
            self.process = None


class CarUpdates:
    """A car that tells its state several times a second, by a clock of its own."""

    def __init__(self, port: int, name: str, *, url: str | None = None, alarms: Sequence[object] = ()) -> None:
        self.topic = f"voltwall/{name}"
        self._ending = threading.Event()
        self._told: dict[str, object] = {}
        self._client = paho.Client(CallbackAPIVersion.VERSION2)
        self._client.will_set(f"{self.topic}/status", b"offline", qos=1, retain=True)
        self._client.connect("127.0.0.1", port)
        self._client.loop_start()
        self.publish("status", b"online")
        self.publish("about", {"url": url, "battery": "team", "segments": [12] * 8})
        self.publish("links", {"rs232": {"state": "live", "lost": 0}, "can": {"state": "off", "lost": 0}})
        self.publish("alarms", list(alarms))
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def publish(self, topic: str, body: object) -> None:
        raw = body if isinstance(body, bytes) else json.dumps(body).encode()
        self._client.publish(f"{self.topic}/{topic}", raw, qos=1, retain=True)

    def _run(self) -> None:
        while not self._ending.wait(0.2):
            values = {
                "time": time.time() - 3600, "sent": {"run": "a", "s": time.monotonic() - 77.0}, "simulated": True,
                "age_s": {"voltage": 0.2, "current": 0.1}, "soc": 0.61, "soc_min": 0.6, "soc_min_cell": 30,
                "voltage_v": 355.2, "current_a": 12.0, "voltage_min_v": 3.651, "voltage_min_cell": 30,
                "temperature_max_degc": 41.0, "temperature_max_cell": 5,
            }  # fmt: skip
            self.publish("accumulator", values | self._told)

    def fall_silent(self) -> None:
        """Go on speaking, of an RS232 line that tells nothing any more: no value is left, none is new."""
        self.publish("links", {"rs232": {"state": "silent", "lost": 0}, "can": {"state": "live", "lost": 0}})
        self._told = dict.fromkeys(VALUES)
        self._told["age_s"] = {"voltage": 30.0, "current": 30.0}
        last = {"time": time.time() - 3630}
        self._told["last_known"] = {"soc": last | {"value": 0.61}, "voltage_min_v": last | {"value": 3.651, "cell": 30}}

    def vanish(self) -> None:
        """Break the connection without a word, as a radio does."""
        self._ending.set()
        self._thread.join()
        self._client.loop_stop()
        line = self._client.socket()
        assert line is not None
        line.close()
