"""`voltwall simulate` as a process: where its ports are, and its end."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing.process import BaseProcess
from typing import TextIO

from tests.forked import start_program

END_S = 40.0


@dataclass
class Simulator:
    """Started with arguments; `urls` says how to open its ports."""

    arguments: list[str]
    urls: dict[str, str] = field(default_factory=dict)
    program: str = "simulator.cli"
    process: BaseProcess | None = None
    output: TextIO | None = None

    def start(self) -> "Simulator":
        """Start it and wait until its ports are open."""
        self.process, self.output = start_program(self.program, self.arguments)
        said = []
        for line in self.output:
            if line == "ready\n":
                return self
            said.append(line)
            name, _, url = line.strip().partition(": ")
            self.urls[name] = url
        raise AssertionError("".join(said))

    @property
    def is_running(self) -> bool:
        """Whether its process lives."""
        return self.process.is_alive()

    def stop(self, signum: int = signal.SIGTERM) -> int | None:
        """End it; its exit code."""
        if self.is_running:
            os.kill(self.process.pid, signum)
        self.process.join(END_S)
        self.output.close()
        return self.process.exitcode


@contextmanager
def simulators() -> Iterator:
    """Start simulators that are ended at the end."""
    started: list[Simulator] = []

    def start(*arguments: str) -> Simulator:
        started.append(Simulator(list(arguments)).start())
        return started[-1]

    yield start
    for item in started:
        if item.is_running:
            item.stop(signal.SIGKILL)
