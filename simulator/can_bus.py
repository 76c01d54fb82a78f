"""The CAN bus in virtual time: every frame reaches every other node that listens at the same bit rate."""

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class CanFrame:
    """One data frame."""

    can_id: int
    is_extended: bool
    data: bytes


class CanListener(Protocol):
    """A node on the bus."""

    @property
    def bit_rate(self) -> int:
        """The bit rate that the node is set to [bit/s]; 0 while it is off the bus."""
        ...

    def can_received(self, frame: CanFrame, now_s: float) -> None:
        """Take a frame that another node sent."""
        ...


class CanBus:
    """The wire; `is_broken` takes every frame away (short circuit, missing terminator)."""

    def __init__(self) -> None:
        self.nodes: list[CanListener] = []
        self.is_broken = False
        self.frames = 0

    def send(self, sender: CanListener, frame: CanFrame, now_s: float) -> None:
        """Carry a frame from one node to the others."""
        if self.is_broken or not sender.bit_rate:
            return
        self.frames += 1
        for node in self.nodes:
            if node is not sender and node.bit_rate == sender.bit_rate:
                node.can_received(frame, now_s)
