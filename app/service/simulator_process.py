"""The simulated accumulator as a process of its own, met only as bytes: a pseudo-terminal, a CAN adapter, a file."""

import logging
import os
import shutil
import socket
import subprocess
import tempfile
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from app.errors import ConfigError
from app.service.settings import Settings
from app.service.simulator_control import SimulatorControl
from app.sessions.worker import command_of
from app.sources.links.serial import Backoff
from app.words import Message

log = logging.getLogger(__name__)
READY_S = 15.0
STOP_S = 5.0


@dataclass(frozen=True, slots=True)
class Ports:
    """Ports that the simulator opens, and how the service reaches them."""

    serial_argument: str
    serial_url: str
    can_argument: str
    can_url: str
    control_argument: str
    folder: Path | None = None  # folder of the links to the pseudo-terminals, removed at the end


def choose_ports(*, pty: bool) -> Ports:
    """Return free ports: pseudo-terminals, or where the system has none, sockets on loopback."""
    if pty:
        folder = Path(tempfile.mkdtemp(prefix="voltwall-"))
        serial, adapter = folder / "rs232", folder / "can"
        return Ports(
            f"pty:{serial}",
            str(serial),
            f"slcan-pty:{adapter}",
            f"slcan:{adapter}?sleep_after_open=0&timeout=0.05",
            str(folder / "control"),
            folder,
        )
    serial_port, can_port = _free_port(), _free_port()
    return Ports(
        f"tcp:{serial_port}",
        f"socket://127.0.0.1:{serial_port}",
        f"slcan-tcp:{can_port}",
        f"slcan:socket://127.0.0.1:{can_port}?sleep_after_open=0&timeout=0.05",
        "0",
    )


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class SimulatorProcess:
    """Started with the service, started again if it dies, ended with the service."""

    def __init__(
        self,
        settings: Settings,
        *,
        of_battery: Sequence[str] | None = None,
        has_serial: bool = False,
        backoff: Backoff | None = None,
        stop_s: float = STOP_S,
    ) -> None:
        """Prepare the process.

        Args:
            settings: of the service.
            of_battery: command line of another simulation than the team's car.
            has_serial: that one is on a serial line; else on CAN alone.
            backoff: between two starts.
            stop_s: how long it may take to end before it is killed.
        """
        self._backoff = backoff or Backoff()
        self._stop_s = stop_s
        self.ports = choose_ports(pty=os.name == "posix")
        eeprom = str(settings.data / "eeprom.bin")
        of_team = ("simulator.cli", "--serial", self.ports.serial_argument, "--eeprom", eeprom)
        self._arguments = [
            *(of_battery or command_of(*of_team)),
            *(("--serial", self.ports.serial_argument) if has_serial else ()),
            *("--can", self.ports.can_argument, "--with-parent", "--control", self.ports.control_argument),
            *(("--seed", str(settings.seed)) if settings.seed is not None else ()),
        ]
        self._scenario = settings.scenario
        self.control = SimulatorControl()
        self._process: subprocess.Popen[bytes] | None = None
        self._stopping = threading.Event()
        self._ready = threading.Event()
        self._restarting = threading.Event()
        self._first_exit: int | None = None
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, name="simulator", daemon=True)

    def start(self) -> None:
        """Start and wait until its ports are open.

        Raises:
            ConfigError: it ended at once; its own words are on stderr.
        """
        self._thread.start()
        self._ready.wait(READY_S)
        if self._first_exit is not None:
            raise ConfigError(
                "scenario", self._scenario or "default", Message("simulator-ended", exit_code=self._first_exit)
            )

    def restart(self, scenario: str) -> None:
        """End the car and start another one on the same ports; its EEPROM stays."""
        with self._lock:
            self._scenario = scenario
            self._restarting.set()
            if self._process is not None:
                self._process.terminate()

    def stop(self) -> None:
        """End it, and leave nothing behind."""
        with self._lock:
            self._stopping.set()
            process = self._process
        if process is not None:
            process.terminate()
            try:
                process.wait(self._stop_s)
            except subprocess.TimeoutExpired:
                process.kill()
        if self._thread.is_alive():
            self._thread.join(timeout=self._stop_s)
        if self.ports.folder is not None:
            shutil.rmtree(self.ports.folder, ignore_errors=True)

    def _run(self) -> None:
        while not self._stopping.is_set():
            with self._lock:  # none is started behind the back of `stop`
                if self._stopping.is_set():
                    return
                chosen = ("--scenario", self._scenario) if self._scenario else ()
                self._process = subprocess.Popen(
                    [*self._arguments, *chosen],
                    stdin=subprocess.PIPE,  # its end is ours
                    stdout=subprocess.PIPE,
                    start_new_session=True,  # Ctrl-C is for the service, which ends it in order
                    creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),  # the same on Windows
                )
            with self._process as process:
                for line in process.stdout or ():
                    name, _, url = line.decode(errors="replace").strip().partition(": ")
                    if name == "control":
                        self.control.url = url
                    elif name == "ready":
                        self._ready.set()
            if self._stopping.is_set():
                return
            code = process.returncode
            if self._restarting.is_set():
                self._restarting.clear()
                continue
            if not self._ready.is_set():
                self._first_exit = code
                self._ready.set()
                return
            log.warning("the simulator exited with code %s and is restarted", code)
            self._stopping.wait(self._backoff.next_s())
