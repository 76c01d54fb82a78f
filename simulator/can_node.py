"""The master's CAN controller: sends and receives by its tables, with period, timeout, answer and sending on demand."""

from collections.abc import Iterator

from firmware_protocol.can_tables import apply_received, bit_rate, message_bytes, rx_messages, tx_messages
from firmware_protocol.memory_map import CONFIG
from firmware_protocol.messages import NO_OFFSET, EventCode, EventMessage
from simulator.can_bus import CanFrame
from simulator.memory import MasterMemory

_BRP_OFFSET = CONFIG["can_brp"].offset


class CanNode:
    """Messages out of the struct and into it, as the configuration in force says."""

    def __init__(self, memory: MasterMemory) -> None:
        self._memory = memory
        self._due_s: dict[int, float] = {}
        self._last_seen_s: dict[int, float] = {}
        self._scheduled = 0
        self._on_demand: list[int] = []
        self.tx_enabled = 0
        self.rx_enabled = 0
        self.rx_active = 0
        self.is_off = False
        self._charge: bool | None = None
        self.configure()

    def configure(self) -> None:
        """Take over the tables and the start-up masks of the configuration in force."""
        self._read_tables()
        self.tx_enabled = sum(1 << tx.index for tx in self._tx if tx.enabled)
        self.rx_enabled = sum(1 << rx.index for rx in self._rx if rx.enabled)
        self.rx_active = 0
        self._scheduled = 0
        self._last_seen_s.clear()

    def reload(self) -> None:
        """Take over changed tables; messages enabled or alive stay so, except where the start-up masks changed."""
        old_tx = sum(1 << tx.index for tx in self._tx if tx.enabled)
        old_rx = sum(1 << rx.index for rx in self._rx if rx.enabled)
        self._read_tables()
        new_tx = sum(1 << tx.index for tx in self._tx if tx.enabled)
        new_rx = sum(1 << rx.index for rx in self._rx if rx.enabled)
        self.tx_enabled = self.tx_enabled & ~(old_tx & ~new_tx) | (new_tx & ~old_tx)
        self.rx_enabled = self.rx_enabled & ~(old_rx & ~new_rx) | (new_rx & ~old_rx)
        self.rx_active &= self.rx_enabled
        self._scheduled = 0

    def _read_tables(self) -> None:
        config = self._memory.config
        self._tx = tx_messages(config)
        self._rx = rx_messages(config)
        self._bit_rate = bit_rate(self._memory.image[_BRP_OFFSET])
        self._by_id = {(rx.can_id, rx.is_extended): rx for rx in reversed(self._rx) if rx.length or rx.enabled}

    def mask_writing(self, offset: int) -> int:
        """Return which rx messages write the struct's byte at `offset`, one bit each."""
        return sum(1 << rx.index for rx in self._rx if offset in rx.data_offsets[: rx.length])

    @property
    def bit_rate(self) -> int:
        """The bit rate of the prescaler in force, 0 in bus-off."""
        return 0 if self.is_off else self._bit_rate

    def enable_tx(self, mask: int) -> None:
        """Send exactly these messages from now on."""
        self.tx_enabled = mask

    def send_once(self, index: int) -> None:
        """Send one message as soon as the controller is served."""
        self._on_demand.append(index)

    def due(self, now_s: float, pass_s: float) -> Iterator[CanFrame]:
        """Yield the frames that are due since the last pass, `pass_s` ago: the firmware's own passes are shorter.

        What is later than that is sent once and not made up for.
        """
        if self._on_demand:
            for index in self._on_demand:
                yield self._frame(index)
            self._on_demand.clear()
        if self.tx_enabled != self._scheduled:
            self._schedule(now_s)
        for index, due_s in self._due_s.items():
            if due_s <= now_s:
                period_s = self._tx[index].period_ms / 1000
                if due_s + period_s <= now_s - pass_s:
                    self._due_s[index] = now_s
                while self._due_s[index] <= now_s:
                    self._due_s[index] += period_s
                    yield self._frame(index)

    def _schedule(self, now_s: float) -> None:
        """Let newly enabled messages start now and forget the others."""
        self._scheduled = self.tx_enabled
        self._due_s = {
            tx.index: self._due_s.get(tx.index, now_s)
            for tx in self._tx
            if self.tx_enabled >> tx.index & 1 and tx.period_ms
        }

    def _frame(self, index: int) -> CanFrame:
        tx = self._tx[index]
        return CanFrame(tx.can_id, tx.is_extended, message_bytes(tx, self._memory.image))

    def received(self, frame: CanFrame, now_s: float) -> None:
        """Store a frame's bytes where the table says, mark it alive and activate its answer."""
        rx = self._by_id.get((frame.can_id, frame.is_extended))
        if rx is None or not self.rx_enabled >> rx.index & 1:
            return
        apply_received(rx, frame.data, self._memory.image)
        if rx.charges and not self.rx_active >> rx.index & 1:
            self._charge = True
        self._last_seen_s[rx.index] = now_s
        self.rx_active |= 1 << rx.index
        if rx.response is not None:
            self.tx_enabled |= 1 << rx.response

    def take_charge(self) -> bool | None:
        """Return once that a message to charge by was heard (True) or went silent (False), None otherwise."""
        charge, self._charge = self._charge, None
        return charge

    def expire(self, now_s: float) -> list[EventMessage]:
        """Mark the messages that have been silent for too long, stop their answers, and return an event for each."""
        if not self.rx_active:
            return []
        events = []
        for rx in self._rx:
            alive = self.rx_active >> rx.index & 1
            if alive and rx.timeout_ms and now_s - self._last_seen_s[rx.index] > rx.timeout_ms / 1000:
                self.rx_active &= ~(1 << rx.index)
                if rx.response is not None:
                    self.tx_enabled &= ~(1 << rx.response)
                if rx.charges:
                    self._charge = False
                events.append(EventMessage(EventCode.CAN_RX_TIMEOUT, 0, NO_OFFSET, rx.index, rx.timeout_ms))
        return events
