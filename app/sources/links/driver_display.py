"""The driver's display over CAN: the energy that a lap may take, and go, slow or box. Off until somebody maps it.

After a start of the service nothing is sent: an engineer switches it on. A lap's target that is not known, or was
judged too long ago, is sent as 0xFFFF, never as the last good one.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from typing import Final, Literal, get_args

from app.clock import Clock
from app.errors import LinkError, NotNow, message_of
from app.sources.links.can_sender import CanSender
from app.telemetry import Snapshot
from app.telemetry.measurement import BLANK_S
from app.words import Message, Text
from firmware_protocol.memory_map import CAN_ID_EXTENDED

DriverMessage = Literal["none", "go", "slow", "box"]
MESSAGES: Final[tuple[DriverMessage, ...]] = get_args(DriverMessage)  # the byte is the place in this list
UNKNOWN: Final = 0xFFFF


@dataclass(frozen=True, slots=True)
class DriverFrame:
    """The CAN frame of a value: bit 31 of the id marks a 29-bit one; the other bytes are 0."""

    can_id: int
    length: int
    start_byte: int
    byte_order: Literal["little", "big"]
    period_ms: int

    def data(self, value: int, size: int) -> bytes:
        """Return the frame's bytes with a value of `size` bytes in its place."""
        before = bytes(self.start_byte)
        return (before + value.to_bytes(size, self.byte_order)).ljust(self.length, b"\0")


class DriverDisplay:
    """Sends the two frames from a thread of its own while they are mapped."""

    def __init__(
        self,
        send: Callable[[int, bytes], None],
        snapshot: Callable[[], Snapshot | None],
        ids_of_others: Callable[[], Collection[int]],
        clock: Clock,
    ) -> None:
        """Prepare; nothing is sent before `send`.

        Args:
            send: puts a frame onto the bus.
            snapshot: the newest of the car.
            ids_of_others: what anybody else on this bus sends or listens to.
            clock: of the periods, and of how old a target is.
        """
        self._send = send
        self._snapshot = snapshot
        self._ids_of_others = ids_of_others
        self._clock = clock
        self._sender = CanSender(self._try, clock)
        self.target: DriverFrame | None = None
        self.message: DriverFrame | None = None
        self.shown: DriverMessage = "none"
        self.sent = 0
        self.error: Text | None = None

    def send(self, target: DriverFrame | None, message: DriverFrame | None, who: str) -> None:
        """Send these from now on, in the place of those before; None: not that one.

        Raises:
            NotNow: an id is another's, or both have the same; what was sent before goes on.
        """
        frames = [frame for frame in (target, message) if frame is not None]
        ids = [frame.can_id for frame in frames]
        taken = set(ids) & set(self._ids_of_others())
        if len(set(ids)) < len(ids):
            taken |= set(ids)
        if taken:
            names = tuple(f"{can_id & ~CAN_ID_EXTENDED:#x}" for can_id in sorted(taken))
            raise NotNow(Message("driver-can-id-taken", ids=names))
        self._sender.stop()
        self.target, self.message, self.shown, self.sent, self.error = target, message, "none", 0, None
        if frames:
            self._sender.start_frames("driver display", self._frames(target, message), len(frames), who)

    def show(self, message: DriverMessage) -> None:
        """Send another message from the next frame on."""
        self.shown = message

    def stop(self) -> None:
        """Send nothing more."""
        self._sender.stop()

    @property
    def target_wh(self) -> float | None:
        """Return the energy that a lap may take [Wh]; None without a race plan, or where the last judgement is old."""
        snapshot = self._snapshot()
        prediction = None if snapshot is None else snapshot.prediction
        if snapshot is None or prediction is None or prediction.target is None:
            return None
        age_s = (prediction.age_s or 0.0) + (self._clock.monotonic_ns() - snapshot.t_mono_ns) / 1e9
        return prediction.target.lap_energy_wh if age_s <= BLANK_S else None

    def _frames(self, target: DriverFrame | None, message: DriverFrame | None) -> Iterator[tuple[float, int, bytes]]:
        """Yield (seconds from the start, id, data) for ever; the data are those of the moment before."""
        due = [(0.0, i, frame) for i, frame in enumerate((target, message)) if frame is not None]
        while True:
            at_s, i, frame = heapq.heappop(due)
            heapq.heappush(due, (at_s + frame.period_ms / 1000, i, frame))
            yield at_s, frame.can_id, frame.data(*((self._target_raw, 2) if i == 0 else (self._message_raw, 1)))

    @property
    def _target_raw(self) -> int:
        wh = self.target_wh
        return UNKNOWN if wh is None else min(max(round(wh), 0), UNKNOWN - 1)

    @property
    def _message_raw(self) -> int:
        return MESSAGES.index(self.shown)

    def _try(self, can_id: int, data: bytes) -> None:
        """A bus that is away for a while ends nothing."""
        try:
            self._send(can_id, data)
        except LinkError as error:
            self.error = message_of(error)
            return
        self.sent, self.error = self.sent + 1, None
