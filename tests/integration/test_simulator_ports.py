"""The simulator's ports from outside: pySerial and python-can open them like the real thing."""

import itertools
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import can
import pytest
import serial

from firmware_protocol.config_image import default_image, with_value
from firmware_protocol.eeprom import newest
from firmware_protocol.framing import LINE_BYTES_PER_S, BadFrame, Frame, FrameDecoder, encode_frame
from firmware_protocol.messages import (
    Command,
    CommandId,
    MessageType,
    Reply,
    Request,
    Result,
    Store,
    Write,
    decode_message,
    encode_request,
)
from simulator.cli import main

WAIT_S = 45.0
needs_pty = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")


def opened(url: str) -> serial.SerialBase:
    """Open a port as a program that has just lost it would: again and again until it is there."""
    end_s = time.monotonic() + WAIT_S
    while True:
        try:
            return serial.serial_for_url(url, baudrate=115_200, parity="E", timeout=0.05)
        except Exception:
            if time.monotonic() > end_s:
                raise


class Line:
    """The computer's end of the RS232 line."""

    def __init__(self, url: str) -> None:
        self.port = opened(url)
        self._decoder = FrameDecoder()
        self._sequence = 0

    def __enter__(self) -> "Line":
        return self

    def __exit__(self, *_: object) -> None:
        self.port.close()

    def frames(self) -> list[Frame]:
        items = self._decoder.feed(self.port.read(max(1, self.port.in_waiting)))
        assert not any(isinstance(item, BadFrame) for item in items)
        return items

    def frames_until(self, condition: Callable[[Frame], bool]) -> list[Frame]:
        out: list[Frame] = []
        end_s = time.monotonic() + WAIT_S
        while time.monotonic() < end_s:
            for frame in self.frames():
                out.append(frame)
                if condition(frame):
                    return out
        raise AssertionError(f"not seen in {len(out)} frames")

    def ask(self, request: Request) -> Reply:
        self._sequence += 1
        message_type, body = encode_request(request)
        self.port.write(encode_frame(message_type, self._sequence, 0, body))
        found = self.frames_until(lambda frame: frame.type == MessageType.REPLY)
        reply = decode_message(found[-1])
        assert isinstance(reply, Reply)
        assert reply.request_sequence == self._sequence
        return reply


@pytest.fixture(params=[pytest.param("pty", marks=needs_pty), "tcp"])
def serial_argument(request, tmp_path) -> str:
    return f"pty:{tmp_path / 'line'}" if request.param == "pty" else "tcp:0"


def test_stream_is_whole_and_no_faster_than_the_line(simulator, serial_argument):
    started = simulator("--serial", serial_argument)
    with Line(started.urls["serial"]) as line:
        line.ask(Write(0, with_value(default_image(), "telemetry_period", 20)))
        line.port.write(b"x")
        line.frames_until(lambda frame: frame.type == MessageType.DATA)
        begin_s, frames = time.monotonic(), []
        while time.monotonic() < begin_s + 2.0:
            frames += line.frames()
        elapsed_s = time.monotonic() - begin_s
    n_bytes = sum(len(frame.raw) + 2 for frame in frames)
    steps = {(b.sequence - a.sequence) & 0xFF for a, b in itertools.pairwise(frames)}
    assert steps == {1}
    assert n_bytes <= (elapsed_s + 0.2) * LINE_BYTES_PER_S


def test_readers_may_come_and_go(simulator, serial_argument):
    started = simulator("--serial", serial_argument)
    for _ in range(3):
        with Line(started.urls["serial"]) as line:
            line.port.write(b"x")
            line.frames_until(lambda frame: frame.type == MessageType.DATA)
    assert started.is_running


def test_stored_configuration_is_in_the_file_at_the_next_start(simulator, tmp_path):
    eeprom = tmp_path / "eeprom.bin"
    arguments = ("--serial", "tcp:0", "--eeprom", str(eeprom))
    wanted = with_value(default_image(), "balance_threshold", 0.011)
    first = simulator(*arguments)
    with Line(first.urls["serial"]) as line:
        assert line.ask(Write(0, wanted)).result == Result.DONE
        assert line.ask(Store()).result == Result.DONE
    assert newest(eeprom.read_bytes()).image == wanted
    assert first.stop() == 0
    second = simulator(*arguments)
    with Line(second.urls["serial"]) as line:
        line.port.write(b"x")
        found = line.frames_until(lambda frame: frame.type == MessageType.DATA and frame.body[:2] == b"\0\0")
    assert found[-1].body[4:40] == wanted[:36]


@needs_pty
def test_a_stale_link_is_replaced_and_removed_at_the_end(simulator, tmp_path):
    link = tmp_path / "line"
    link.symlink_to(tmp_path / "gone")
    started = simulator("--serial", f"pty:{link}")
    with Line(str(link)) as line:
        assert line.ask(Command(CommandId.SET_SOC, 5000)).result == Result.DONE
    assert started.stop() == 0
    assert not link.is_symlink()


@needs_pty
def test_a_file_in_the_way_is_left_alone(tmp_path, capsys):
    path = tmp_path / "precious"
    path.write_text("precious")
    assert main(["--serial", f"pty:{path}"]) == 2
    assert "in the way" in capsys.readouterr().err
    assert path.read_text() == "precious"


@pytest.mark.parametrize("kind", [pytest.param("slcan-pty", marks=needs_pty), "slcan-tcp"])
def test_python_can_opens_the_adapter_and_hears_and_sends(simulator, tmp_path, kind):
    where = str(tmp_path / "can") if kind == "slcan-pty" else "0"
    started = simulator("--can", f"{kind}:{where}")
    interface, _, channel = started.urls["can"].partition(":")
    with can.Bus(channel, interface=interface, bitrate=500_000, sleep_after_open=0) as bus:
        seen = [bus.recv(WAIT_S) for _ in range(5)]
        assert {message.arbitration_id for message in seen} <= {0x100, 0x101}
        # a charger that shows itself is answered with commands
        status = can.Message(arbitration_id=0x18FF50E5, is_extended_id=True, data=bytes(8))
        bus.send(status)
        end_s = time.monotonic() + WAIT_S
        while time.monotonic() < end_s:
            message = bus.recv(0.2)
            if message is not None and message.arbitration_id == 0x1806E5F4:
                break
        else:
            raise AssertionError("no command for the charger")
        assert message.is_extended_id
        assert message.data[4] == 1  # stop: nobody asked for charging


def test_it_ends_with_its_parent():
    command = [sys.executable, "-m", "simulator.cli", "--serial", "tcp:0", "--with-parent"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert "ready\n" in iter(process.stdout.readline, "")
        process.stdin.close()
        assert process.wait(WAIT_S) == 0


@pytest.mark.parametrize("signum", [signal.SIGTERM, signal.SIGINT])
def test_it_ends_on_signals(simulator, signum):
    assert simulator("--serial", "tcp:0").stop(signum) == 0


@pytest.mark.skipif(not hasattr(socket, "AF_UNIX"), reason="no Unix sockets")
def test_faults_and_unplugging_over_the_control_port(simulator, tmp_path):
    control = tmp_path / "control"
    started = simulator("--serial", f"pty:{tmp_path / 'line'}", "--control", str(control))

    def ask(request: dict[str, object]) -> dict[str, object]:
        with socket.socket(socket.AF_UNIX) as client:
            client.settimeout(WAIT_S)
            client.connect(str(control))
            client.sendall(json.dumps(request).encode() + b"\n")
            return json.loads(client.makefile().readline())

    with Line(started.urls["serial"]) as line:
        assert ask({"do": "inject", "fault": "slave-lost", "pack": 2}) == {"ok": True, "fault": "slave-lost"}
        event = line.frames_until(lambda frame: frame.type == MessageType.EVENT and frame.body[0] == 8)[-1]
        assert decode_message(event).cell == 12
        assert ask({"do": "unplug", "for_s": 0.3}) == {"ok": True}
        with pytest.raises(OSError):  # noqa: PT011 - SerialException or EIO, as the moment has it
            line.frames_until(lambda frame: False)
    with Line(started.urls["serial"]) as line:
        line.port.write(b"x")
        line.frames_until(lambda frame: frame.type == MessageType.DATA)


def test_as_fast_as_possible_is_faster_than_the_clock(monkeypatch):
    monkeypatch.setattr(signal, "signal", lambda *_: None)  # those of the test's process stay
    begin_s = time.process_time()
    assert main(["--scenario", "acceleration", "--speed", "max", "--duration", "100"]) == 0
    assert time.process_time() - begin_s < 50


@pytest.mark.parametrize(
    "arguments",
    [
        ["--serial", "serial:/dev/null"],
        ["--serial", "tcp:70000"],
        ["--serial", "pty:/nowhere/master"],
        ["--can", "nonsense"],
        ["--can", "slcan-tcp:x"],
        ["--can", "no-such-interface:0"],
        ["--scenario", "no-such-scenario"],
        ["--describe", "no-such-scenario"],
    ],
)
def test_what_cannot_be_opened_is_said_in_one_line(arguments, capsys):
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert said.startswith("voltwall simulate: ")
    assert len(said.splitlines()) == 1


def test_idle_processor_time_is_a_small_part_of_a_core(simulator):
    started = simulator("--serial", "tcp:0")
    with Line(started.urls["serial"]) as line:
        line.port.write(b"x")
        line.frames_until(lambda frame: frame.type == MessageType.DATA)

        def cpu_s() -> float:
            fields = Path(f"/proc/{started.process.pid}/stat").read_text().rpartition(")")[2].split()
            return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

        if not Path("/proc/self/stat").exists():
            pytest.skip("no /proc on this system")
        before_s, begin_s = cpu_s(), time.monotonic()
        while time.monotonic() < begin_s + 4.0:
            line.frames()
        assert cpu_s() - before_s < 0.2 * 4.0
