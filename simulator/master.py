"""The virtual master: the firmware's tasks over one struct, from its boot to its next reset.

`measure` is one pass over sensors, protection and outputs, every 20 ms as the slaves allow. Bytes come in by `receive`,
frames leave by `next_frame` when the line is free. It reads the board's sensors, never the true state of a cell.
"""

import math

import numpy as np

from firmware_protocol.config_image import default_image
from firmware_protocol.framing import LINE_SILENCE_S, CommandDecoder, Frame, StreamCommand, encode_frame
from firmware_protocol.memory_map import CELLS_PER_PACK, FIELDS
from firmware_protocol.messages import (
    NO_OFFSET,
    CommandId,
    Data,
    EventCode,
    EventMessage,
    Ident,
    MessageType,
    Reply,
    Window,
)
from firmware_protocol.schedule import StreamSchedule
from simulator.board import Board
from simulator.can_node import CanNode
from simulator.charging import Balancer, Charging, ChargingState
from simulator.fans import Fans
from simulator.line import Outbox
from simulator.measuring_task import MeasuringTask
from simulator.memory import FLAG, Config, MasterMemory
from simulator.protection import Protection, violations
from simulator.relays import Relays, RelayState, TellsRelays
from simulator.requests import RequestHandler
from simulator.soc_counter import SocCounter
from simulator.storage import ConfigStore

FIRMWARE_VERSION = (1, 0, 0)
PASS_S = 0.02
RESET_DELAY_S = 0.1  # so that the reply to the command leaves first
SLAVE_REFRESH_S = 1.0
NO_CHARGER = 255
POWER_ON = 0
_DRIVING = (RelayState.VEHICLE, RelayState.PRECHARGE)
_FIT, _I2C1, _USART1, _CAN1, _CHARGER, _CHARGING, _BALANCING, _LOAD = (
    FLAG[name] for name in ("fit", "i2c1", "usart1", "can1", "charger", "charging", "balancing", "load")
)
_CHARGER_FLAGS_OFFSET = FIELDS["charger.flags"].offset


class VirtualMaster(TellsRelays):
    """The firmware between a boot and a reset."""

    def __init__(self, board: Board, now_s: float, reset_cause: int = 0) -> None:
        board.boots += 1
        self.board = board
        self._boot_s = now_s
        self._reset_cause = reset_cause
        self._sequence = 0
        self._outbox = Outbox()
        self._decoder = CommandDecoder()
        self._last_byte_s = now_s
        self.memory = MasterMemory()
        self.store = ConfigStore(board.eeprom, now_s)
        self._requests = RequestHandler(self)
        self._stream: StreamSchedule | None = None
        self.emit(EventMessage(EventCode.BOOT, 0, NO_OFFSET, reset_cause, 0))
        stored = self.store.config_at_start()
        if stored is None:
            self.emit(EventMessage(EventCode.EEPROM_INVALID, 0, NO_OFFSET, 0, 0))
        self.memory.config = stored or default_image()
        self.config = Config.from_image(self.memory.image)
        self.can = CanNode(self.memory)
        self._charger_mask = self.can.mask_writing(_CHARGER_FLAGS_OFFSET)
        self._measurement = MeasuringTask(self.memory, board, now_s)
        self._soc = SocCounter()
        if reset_cause != POWER_ON and self.store.journal is not None:
            self._soc.start_from_journal(self.store.journal.dod_raw)
        self._balancer = Balancer()
        self.charging = Charging(self.memory, self._balancer)
        self.protection = Protection(board.latch)
        self._relays = Relays()
        self.fans = Fans()
        self._balance_asked = False
        self._slave_refresh_s = now_s
        self.drive_requested = False
        self.is_shutdown_closed = True  # the rest of the circuit: buttons, insulation monitor, interlocks
        self.reset_due_s: float | None = None

    # --- outputs

    @property
    def fan_duty(self) -> float:
        """Duty of the fans, 0..1."""
        return self.memory.charger("fan_duty") / 255

    @property
    def is_at_work(self) -> bool:
        """Relays are closed or closing, or charging is active: only live fields of the configuration may change."""
        return self._relays.state is not RelayState.OPEN or self.charging.is_active

    # --- one pass

    def measure(self, now_s: float, dt_s: float, true_current_a: float) -> None:
        """Run one pass: measure, protect, charge, balance, set relays and fans."""
        config = self.config
        reading = self._measurement.run(config, now_s, dt_s, true_current_a, self.charging.is_active)
        is_ready = self._measurement.is_ready
        self._count_charge(now_s, reading.i_fc)
        events = self.protection.judge(violations(config, reading), now_s) if is_ready else []
        events += self.can.expire(now_s)
        charger_alive = bool(self.can.rx_active & self._charger_mask)
        events += self._follow_charger(now_s)
        if not self.protection.is_ok:
            self._stop_balancing()
            events += self.charging.stop(now_s, fault=True)
        if self.drive_requested and not self.charging.is_active:
            events += self.charging.stop(now_s)
        events += self.charging.step(config, now_s, charger_alive=charger_alive, v_max=reading.v_max)
        self._relays.step(
            now_s,
            is_ok=self.protection.is_ok and self.is_shutdown_closed,
            drive_requested=self.drive_requested and is_ready,
            charging=self.charging.is_active,
            link_share=self.board.link_share,
        )
        self._balance(now_s)
        self.memory.set_charger("fan_duty", self.fans.duty(config, reading.t_max, now_s))
        self._write_status(charger_alive)
        self._emit_all(events)
        self._run_store(now_s)
        if now_s - self._last_byte_s > LINE_SILENCE_S:
            self._decoder.idle()

    def _follow_charger(self, now_s: float) -> list[EventMessage]:
        """Begin and end charging with the message that the configuration names; by hand it ends as ever."""
        match self.can.take_charge():
            case True if self._may_charge:
                return self.charging.start(now_s)
            case False:
                return self.charging.stop(now_s)
        return []

    @property
    def _may_charge(self) -> bool:
        return self._relays.state not in _DRIVING and not self.drive_requested and self.protection.is_ok

    def _count_charge(self, now_s: float, i_fc: int) -> None:
        if self._soc.is_started:
            for i_fs in self._measurement.new_means:
                self._soc.count(self.config, i_fs)
        elif self._measurement.is_ready:
            self._soc.start_from_rest(self.config, self._measurement.v_avg, i_fc)
        dod, soc = self._soc.dod_uah, self._soc.soc_counts(self.config)
        self.memory.set_charge(dod, soc)
        if self._soc.is_started:
            self.store.remember(dod, soc, now_s)

    def _stop_balancing(self) -> None:
        self._balance_asked = False
        if not self.charging.is_active:
            self._balancer.stop()

    def _balance(self, now_s: float) -> None:
        self._balancer.watch_by_hand(self.config, self.memory.v, now_s)
        if self._balance_asked and self.charging.state != ChargingState.BALANCING:
            self._balance_asked = self._balancer.choose(self.config, self.memory.v)
        if now_s >= self._slave_refresh_s:
            self._slave_refresh_s = now_s + SLAVE_REFRESH_S
            self._measurement.reader.configure(self._balancer.cells)

    def _write_status(self, charger_alive: bool) -> None:
        self.memory.flags = (
            _FIT * self.protection.is_ok
            | _I2C1 * (not self.board.eeprom.worn_pages)
            | _USART1 * self.is_streaming
            | _CAN1 * (self.can.bit_rate > 0)
            | _CHARGER * charger_alive
            | _CHARGING * self.charging.is_active
            | _BALANCING * self._balancer.is_active
            | _LOAD * (self._relays.state is RelayState.VEHICLE)
        )
        self.memory.set_can_masks(self.can.tx_enabled, self.can.rx_enabled, self.can.rx_active)
        self.memory.set_charger_status(self.memory.charger("flags") if charger_alive else NO_CHARGER)

    # --- configuration

    def use_config(self, config: bytes) -> None:
        """Put a checked configuration in force."""
        self.memory.config = config
        self.config = Config.from_image(self.memory.image)
        if self._stream is not None:
            self._stream.period_s = self.config.telemetry_period / 1000
        self.can.reload()
        self._charger_mask = self.can.mask_writing(_CHARGER_FLAGS_OFFSET)
        self._slave_refresh_s = 0.0

    def _run_store(self, now_s: float) -> None:
        finished = self.store.run(now_s)
        if finished is None:
            return
        reply, event = finished
        self._requests.finished(reply, now_s)
        self._send_reply(reply)
        if event is not None:
            self.emit(event)

    def store_config(self, now_s: float) -> bool:
        """Store the configuration in force; return whether it began."""
        return self.store.start(0, self.memory.config, now_s)

    def lose_power(self, rng: np.random.Generator) -> None:
        """Lose power; a write that is under way is interrupted."""
        self.store.lose_power(rng)

    # --- commands

    def command(self, command: CommandId, argument: int, now_s: float) -> bool:
        """Carry out a command with a checked argument; return False where the state forbids it."""
        is_driving = self._relays.state in _DRIVING
        match command:
            case CommandId.CHARGE_START:
                if not self._may_charge:
                    return False
                self._emit_all(self.charging.start(now_s))
            case CommandId.CHARGE_STOP:
                self._emit_all(self.charging.stop(now_s))
            case CommandId.BALANCE_START:
                if is_driving or self.charging.is_active or not self.protection.is_ok:
                    return False
                self._balancer.stop()
                self._balance_asked = True
            case CommandId.BALANCE_CELLS:
                if is_driving or self.charging.is_active or not self.protection.is_ok:
                    return False
                self._balance_asked = False
                self._balancer.choose_by_hand(argument >> CELLS_PER_PACK, argument & 0xFFF, now_s)
                self._slave_refresh_s = 0.0
            case CommandId.SOC_FROM_OCV:
                if not self._measurement.is_ready or not self._soc.start_from_rest(
                    self.config, self._measurement.v_avg, FIELDS["i_fc"].unpack(self.memory.image)[0]
                ):
                    return False
                soc = self._soc.soc_counts(self.config)
                self.emit(EventMessage(EventCode.SOC_SET, 0, NO_OFFSET, soc, 0))
            case CommandId.BALANCE_STOP:
                self._stop_balancing()
            case CommandId.FAN_OVERRIDE:
                self.fans.command(argument, now_s)
            case CommandId.CLEAR_FAULTS:
                if not self.protection.clear():
                    return False
                self._emit_all(self.charging.stop(now_s))
                self._relays.retry()
                self.emit(EventMessage(EventCode.FAULTS_CLEARED, 0, NO_OFFSET, 0, 0))
            case CommandId.SET_SOC:
                self._soc.set_soc(self.config, argument)
                self.emit(EventMessage(EventCode.SOC_SET, 0, NO_OFFSET, argument, 0))
            case CommandId.CAN_TX_ENABLE:
                self.can.enable_tx(argument)
            case CommandId.CAN_SEND:
                self.can.send_once(argument)
            case CommandId.RESET:
                if is_driving:
                    return False
                self.reset_due_s = now_s + RESET_DELAY_S
        return True

    # --- RS232

    def ident(self) -> Ident:
        """Return the answer to IDENT."""
        return Ident(FIRMWARE_VERSION, reset_cause=self._reset_cause, boots=self.board.boots)

    def receive(self, data: bytes, now_s: float) -> None:
        """Take bytes from the line."""
        if now_s - self._last_byte_s > LINE_SILENCE_S:
            self._decoder.idle()
        self._last_byte_s = now_s
        for item in self._decoder.feed(data):
            if isinstance(item, StreamCommand):
                self._switch_stream(item.start, now_s)
            elif isinstance(item, Frame):
                reply = self._requests.handle(item, now_s)
                if reply is not None:
                    self._send_reply(reply)

    @property
    def is_streaming(self) -> bool:
        """The host has asked for telemetry."""
        return self._stream is not None

    def _switch_stream(self, on: bool, now_s: float) -> None:
        if not on:
            self._stream = None
        elif self._stream is None:
            self._stream = StreamSchedule(self.config.telemetry_period / 1000, now_s)

    def next_frame(self, now_s: float) -> bytes | None:
        """Return the next frame for the free line, None where there is none."""
        if self._outbox:
            return self._frame(*self._outbox.pop(), now_s)
        spans = None if self._stream is None else self._stream.take(now_s)
        if spans is None:
            return None
        image = self.memory.image
        data = Data(tuple(Window(offset, bytes(image[offset : offset + length])) for offset, length in spans))
        return self._frame(MessageType.DATA, data.to_body(), now_s)

    def next_due_s(self, now_s: float) -> float:
        """Return the earliest time at which there may be a frame to send."""
        if self._outbox:
            return now_s
        return math.inf if self._stream is None else self._stream.due_s(now_s)

    def emit(self, event: EventMessage) -> None:
        """Queue an event for the host."""
        self._outbox.put(MessageType.EVENT, event.to_body())

    def _emit_all(self, events: list[EventMessage]) -> None:
        for event in events:
            self.emit(event)

    def _send_reply(self, reply: Reply) -> None:
        self._outbox.put(MessageType.REPLY, reply.to_body())

    def _frame(self, message_type: int, body: bytes, now_s: float) -> bytes:
        frame = encode_frame(message_type, self._sequence, round((now_s - self._boot_s) * 1000), body)
        self._sequence = (self._sequence + 1) & 0xFF
        return frame
