"""A simulated car whose EEPROM loses its power in a store, or whose firmware is of another version."""

import argparse
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path

from firmware_protocol.eeprom import SLOT_OFFSETS, SLOT_SIZE
from firmware_protocol.framing import FrameDecoder, encode_frame
from firmware_protocol.memory_map import MAP_HASH
from simulator import cli, eeprom
from simulator.master import VirtualMaster
from tests.simulator_port import Simulator

POWER_LOST = 9


class FailingCar:
    """`voltwall simulate` in the pit, behind a pseudo-terminal, its EEPROM in a file that outlives it."""

    def __init__(self, folder: Path) -> None:
        self.link = folder / "car"
        self._eeprom = folder / "car-eeprom.bin"
        self._car: Simulator | None = None

    def start(self, *options: str) -> "FailingCar":
        """Switch it on, with options of `main`; the port is there on return."""
        words = ["--serial", f"pty:{self.link}", "--eeprom", str(self._eeprom), "--scenario", "in-the-pit", *options]
        self._car = Simulator(words, program="tests.failing_car").start()
        return self

    def stop(self) -> None:
        """Switch it off, if it still runs."""
        self._car.stop()


class FailingEeprom(eeprom.Eeprom):
    """Loses its power when so many bytes of the configuration have been written; its port is gone with it."""

    def __init__(self, path: Path | None = None, *, cut_after: int, link: Path) -> None:
        super().__init__(path)
        self._left, self._link = cut_after, link

    def write(self, address: int, data: bytes) -> None:
        """Write a page, or what of it can be."""
        if address >= len(SLOT_OFFSETS) * SLOT_SIZE:
            super().write(address, data)
            return
        super().write(address, data[: self._left])
        self._left -= len(data)
        if self._left < 0:
            self._link.unlink()  # another test's car may get its terminal's number
            os._exit(POWER_LOST)


def of_another_map(
    next_frame: Callable[[VirtualMaster, float], bytes | None], master: VirtualMaster, now_s: float
) -> bytes | None:
    """Return the next frame, in which the master says that its struct is another one."""
    raw = next_frame(master, now_s)
    for frame in FrameDecoder().feed(raw or b""):
        if MAP_HASH in frame.body:
            body = frame.body.replace(MAP_HASH, bytes(len(MAP_HASH)))
            return encode_frame(frame.type, frame.sequence, frame.uptime_ms, body)
    return raw


def main(arguments: list[str]) -> int:
    """Be the process: what `voltwall simulate` takes, and how it fails."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--cut-after", type=int)
    parser.add_argument("--serial")
    parser.add_argument("--other-map", action="store_true")
    fault, others = parser.parse_known_args(arguments)
    if fault.cut_after is not None:
        link = Path(fault.serial.removeprefix("pty:"))
        eeprom.Eeprom = partial(FailingEeprom, cut_after=fault.cut_after, link=link)
    if fault.other_map:
        next_frame = VirtualMaster.next_frame
        VirtualMaster.next_frame = lambda master, now_s: of_another_map(next_frame, master, now_s)
    return cli.main(["--serial", fault.serial, *others])
