"""A thousand cars at one real broker: how late the page of all cars is, and what it costs.

    python -m benchmarks.fleet [--cars 1000] [--seconds 60]

Every car is a connection of its own that publishes what the service does of a 96-cell battery: once a second the six
topics that change, the others at the start; by MQTT 3.1.1 over plain sockets, from one process. The broker is a real
mosquitto, the listener `voltwall serve --fleet`. The delay is from the moment of publishing to a subscriber's callback
(same machine, same clock). Methods: what the page subscribes to (six topics of each car, of which one comes every
second), against everything (`PREFIX/#`). Then the broker is killed and started again.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import multiprocessing
import os
import random
import resource
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections import Counter
from pathlib import Path

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

from app.service.mqtt.cars import TOPICS
from tests.mosquitto import Mosquitto

CELLS = 96
TICKS = os.sysconf("SC_CLK_TCK")


def packet(kind: int, body: bytes) -> bytes:
    """Return an MQTT packet with its remaining length."""
    length, left = b"", len(body)
    while True:
        left, digit = divmod(left, 128)
        length += bytes([digit | (0x80 if left else 0)])
        if not left:
            return bytes([kind]) + length + body


def text(value: str | bytes) -> bytes:
    """Return a string with its length, as MQTT has it."""
    raw = value.encode() if isinstance(value, str) else value
    return len(raw).to_bytes(2, "big") + raw


def publish(topic: str, body: object) -> bytes:
    """Return a retained message of QoS 0."""
    raw = body if isinstance(body, bytes) else json.dumps(body).encode()
    return packet(0x31, text(topic) + raw)


def connect(name: str) -> bytes:
    """Return the packet that opens a connection with a last will, as the service has it."""
    head = text("MQTT") + bytes([4, 0x02 | 0x04 | 0x08 | 0x20]) + (15).to_bytes(2, "big")
    return packet(0x10, head + text(name) + text(f"voltwall/{name}/status") + text(b"offline"))


async def car(name: str, rng: random.Random) -> None:
    """Publish once a second for ever; connect again where the broker is gone."""
    base, cells = f"voltwall/{name}", [3.7] * CELLS
    stamp = {"time": time.time(), "source": "serial", "simulated": False}
    rest = b"".join(
        publish(f"{base}/cells/{each}", stamp | {"age_s": 0.1, "stale": False, "values": cells})
        for each in ("voltage_v", "temperature_degc", "soc", "soc_sigma")
    )
    rest += publish(f"{base}/recording", {"session_id": "20261123T022328Z", "frames": 1234, "bytes": 123456})
    once = publish(f"{base}/status", b"online")
    once += publish(f"{base}/links", {"rs232": {"state": "live", "lost": 0}, "can": {"state": "live", "lost": 0}})
    once += publish(f"{base}/master", {"state": "drive", "simulated": False}) + publish(f"{base}/alarms", [])
    values = (
        stamp | {f"value_{i}": 3.6543 for i in range(24)} | {"soc": 0.6, "voltage_min_v": 3.6, "voltage_min_cell": 7}
    )
    while True:
        await asyncio.sleep(rng.random())
        with contextlib.suppress(OSError, asyncio.IncompleteReadError):
            reader, writer = await asyncio.open_connection("127.0.0.1", PORT)
            writer.write(connect(name) + once)
            await reader.readexactly(4)
            due = time.monotonic()
            while True:
                sent = {"run": name, "s": time.monotonic()}
                told = values | {"sent": sent, "age_s": {"voltage": 0.1, "current": 0.1}}
                writer.write(publish(f"{base}/accumulator", told) + rest)
                await writer.drain()
                due += 1.0
                await asyncio.sleep(max(0.0, due - time.monotonic()))


PORT = 0


def publishers(n_cars: int, port: int) -> None:
    """Run all cars."""
    global PORT
    PORT = port
    rng = random.Random(1)

    async def all_cars() -> None:
        await asyncio.gather(*(car(f"car{i:04}", rng) for i in range(n_cars)))

    asyncio.run(all_cars())


def cost(pid: int) -> tuple[float, float]:
    """Return processor seconds so far and megabytes resident."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return (int(fields[11]) + int(fields[12])) / TICKS, pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def cars_of(url: str) -> tuple[list[dict[str, object]], float, int]:
    """Return what the page is told, how long the answer took [s] and its bytes."""
    start = time.perf_counter()
    with urllib.request.urlopen(f"{url}/api/v1/fleet", timeout=60) as answer:
        body = answer.read()
    return json.loads(body)["cars"], time.perf_counter() - start, len(body)


def listen(port: int, topics: list[str], seconds: float) -> None:
    """Subscribe as the page does and print the delay of every car's values, and this process's cost."""
    delays: list[float] = []
    messages = 0

    def on_message(_client: object, _data: object, message: paho.MQTTMessage) -> None:
        nonlocal messages
        messages += 1
        if message.topic.endswith("/accumulator") and not message.retain:
            delays.append(time.monotonic() - json.loads(message.payload)["sent"]["s"])

    client = paho.Client(CallbackAPIVersion.VERSION2)
    client.on_message = on_message
    client.on_connect = lambda client, *_: client.subscribe([(topic, 1) for topic in topics])
    client.connect("127.0.0.1", port)
    client.loop_start()
    time.sleep(5)
    delays.clear()
    messages, before = 0, time.process_time()
    time.sleep(seconds)
    used = (time.process_time() - before) / seconds
    client.disconnect()
    client.loop_stop()
    cut = statistics.quantiles(delays, n=100)
    print(
        f"{'everything' if topics[0].endswith('#') else 'six topics':12} {messages / seconds:8.0f} messages/s  "
        f"delay median {1e3 * cut[49]:7.1f} ms, p99 {1e3 * cut[98]:7.1f} ms, most {1e3 * max(delays):7.1f} ms  "
        f"listener {100 * used:4.0f} % of a core",
        flush=True,
    )


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cars", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=60.0)
    args = parser.parse_args()
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, 65536), hard))
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        broker = Mosquitto(Path(folder)).start()
        stack.callback(broker.kill)
        crowd = multiprocessing.get_context("spawn").Process(target=publishers, args=(args.cars, broker.port))
        crowd.start()
        stack.callback(crowd.kill)
        url = f"mqtt://127.0.0.1:{broker.port}"
        program = [sys.executable, "-m", "app.cli", "serve", "--fleet", url, "--port", "0", "--data", f"{folder}/fleet"]
        fleet = subprocess.Popen(program, stdout=subprocess.PIPE, text=True)
        stack.callback(fleet.kill)
        assert fleet.stdout is not None
        page = next(line.split("Voltwall: ")[1].strip() for line in fleet.stdout if "Voltwall: " in line)
        wait_for_all(page, args.cars)
        assert broker.process is not None
        for topics in ([f"voltwall/+/{topic}" for topic in sorted(TOPICS)], ["voltwall/#"]):
            pids = (broker.process.pid, fleet.pid, crowd.pid or 0)
            before, start = [cost(pid)[0] for pid in pids], time.monotonic()
            listen(broker.port, topics, args.seconds)
            took = time.monotonic() - start
            for name, pid, used in zip(("mosquitto", "fleet page", "the cars"), pids, before, strict=True):
                cpu, megabytes = cost(pid)
                print(
                    f"{'':12} {name:10} {100 * (cpu - used) / took:4.0f} % of a core, {megabytes:6.1f} MB", flush=True
                )
        cars, took, size = cars_of(page)
        ages = [float(str(each["age_s"])) for each in cars if each["age_s"] is not None]
        states = Counter(str(each["state"]) for each in cars)
        shown = f"ages shown {min(ages):.2f} to {max(ages):.2f} s"
        print(f"page: {dict(states)}, {size / 1e6:.2f} MB in {1e3 * took:.0f} ms, {shown}", flush=True)
        broker.kill()
        broker.start()
        start = time.monotonic()
        wait_for_all(page, args.cars)
        print(f"broker killed and started again: all cars live after {time.monotonic() - start:.1f} s")


def wait_for_all(page: str, n_cars: int, measured_after: float = 0.0) -> None:
    """Return once every car is live with values of after this unix time."""
    deadline = time.monotonic() + 300
    while True:
        cars = cars_of(page)[0]
        live = [each for each in cars if each["state"] == "live" and float(str(each["since"])) > measured_after]
        if len(live) == n_cars:
            return
        assert time.monotonic() < deadline, f"{len(live)} of {n_cars} cars are live"
        time.sleep(0.2)


if __name__ == "__main__":
    main()
