"""The modules of the master in C, as Python objects: each with a struct of its own, times in seconds."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path

import numpy as np

from firmware_protocol.config_image import default_image
from firmware_protocol.memory_map import CELLS_PER_PACK, CONFIG, CONFIG_SIZE, MASTER_SIZE, N_CELLS, N_PACKS
from firmware_protocol.messages import NO_OFFSET, EventCode, EventMessage
from simulator import firmware
from simulator.bms_state import ChargingState, Latch, RelayState
from tests.master_memory import Config, MasterMemory

NONE = 0xFF
N_TRIPS = 8


@dataclass(slots=True)
class Reading:
    """`vw_reading_t`; None for what is not lost."""

    v_min: int
    v_min_id: int
    v_max: int
    v_max_id: int
    t_min: int
    t_min_id: int
    t_max: int
    t_max_id: int
    i_fc: int
    is_charging: bool
    lost_cell: int | None
    lost_temperature: int | None
    lost_slave: int | None
    lost_current: bool


def ms(seconds: float) -> int:
    """Return a time as the firmware has it."""
    return round(seconds * 1000) & 0xFFFFFFFF


@cache
def image_of(config: Config) -> bytes:
    """Return an image that holds these scalars."""
    image = bytearray(default_image())
    for field in fields(config):
        CONFIG[field.name].pack_into(image, (getattr(config, field.name),))
    return bytes(image)


class Event(ctypes.Structure):
    """`vw_event_t`."""

    _fields_ = (
        ("code", ctypes.c_uint8),
        ("argument", ctypes.c_uint8),
        ("cell", ctypes.c_uint16),
        ("value", ctypes.c_int32),
        ("limit", ctypes.c_int32),
    )

    def message(self) -> EventMessage:
        """Return it as Python has it."""
        return EventMessage(EventCode(self.code), self.argument, self.cell, self.value, self.limit)


class CReading(ctypes.Structure):
    """`vw_reading_t`."""

    _fields_ = (
        ("v_min", ctypes.c_uint16),
        ("v_max", ctypes.c_uint16),
        ("t_min", ctypes.c_int8),
        ("t_max", ctypes.c_int8),
        ("v_min_id", ctypes.c_uint8),
        ("v_max_id", ctypes.c_uint8),
        ("t_min_id", ctypes.c_uint8),
        ("t_max_id", ctypes.c_uint8),
        ("i_fc", ctypes.c_int32),
        ("is_charging", ctypes.c_bool),
        ("lost_current", ctypes.c_bool),
        ("lost_cell", ctypes.c_uint8),
        ("lost_temperature", ctypes.c_uint8),
        ("lost_slave", ctypes.c_uint8),
    )

    @classmethod
    def of(cls, reading: Reading) -> CReading:
        """Return a reading as C has it."""
        values = {field.name: getattr(reading, field.name) for field in fields(reading)}
        return cls(**{name: NONE if value is None else value for name, value in values.items()})


class ProtectionState(ctypes.Structure):
    """`vw_protection_t`."""

    _fields_ = (
        ("since_ms", ctypes.c_uint32 * N_TRIPS),
        ("critical", ctypes.c_uint8),
        ("tripped", ctypes.c_uint8),
        ("is_open", ctypes.c_bool),
    )


class FansState(ctypes.Structure):
    """`vw_fans_t`."""

    _fields_ = (
        ("is_overridden", ctypes.c_bool),
        ("has_end", ctypes.c_bool),
        ("override", ctypes.c_uint8),
        ("until_ms", ctypes.c_uint32),
    )


class RelaysState(ctypes.Structure):
    """`vw_relays_t`."""

    _fields_ = (("state", ctypes.c_int), ("since_ms", ctypes.c_uint32), ("has_failed", ctypes.c_bool))


class RelayInputs(ctypes.Structure):
    """`vw_relay_inputs_t`."""

    _fields_ = (
        ("is_ok", ctypes.c_bool),
        ("is_drive_asked", ctypes.c_bool),
        ("is_charging", ctypes.c_bool),
        ("link_permille", ctypes.c_uint16),
    )


@cache
def library(path: Path | None = None) -> ctypes.PyDLL:
    """Return the library, by default the one that the simulator loads."""
    loaded = firmware.load() if path is None else ctypes.PyDLL(str(path))
    for name in ("vw_protection_check", "vw_fans_duty"):
        if hasattr(loaded, name):
            getattr(loaded, name).restype = ctypes.c_uint8
    loaded.vw_protection_clear.restype = ctypes.c_bool
    return loaded


class CProtection:
    """`vw_protection`."""

    def __init__(self, latch: Latch, path: Path | None = None) -> None:
        self._library, self._latch, self._state = library(path), latch, ProtectionState()
        self._library.vw_protection_init(ctypes.byref(self._state), latch.is_open)

    @property
    def is_ok(self) -> bool:
        """The OK signal."""
        return not self._latch.is_open

    def judge(self, config: Config, reading: Reading, now_s: float) -> list[EventMessage]:
        """Take a reading and return an event for each limit that has just tripped."""
        self._state.is_open = self._latch.is_open
        trips, read = (Event * N_TRIPS)(), CReading.of(reading)
        n = self._library.vw_protection_check(
            ctypes.byref(self._state), image_of(config), ctypes.byref(read), ms(now_s), trips
        )
        self._latch.is_open = self._state.is_open
        return [trip.message() for trip in trips[:n]]

    def clear(self) -> bool:
        """Release the latch unless a limit is violated now."""
        is_clear: bool = self._library.vw_protection_clear(ctypes.byref(self._state))
        self._latch.is_open = self._state.is_open
        return is_clear


class CFans:
    """`vw_fans`."""

    def __init__(self) -> None:
        self._state = FansState()
        library().vw_fans_init(ctypes.byref(self._state))

    def command(self, argument: int, now_s: float) -> None:
        """Take the argument of FAN_OVERRIDE."""
        library().vw_fans_command(ctypes.byref(self._state), argument, ms(now_s))

    def duty(self, config: Config, t_max_degc: int, now_s: float) -> int:
        """Return the duty in force [1/255]."""
        duty: int = library().vw_fans_duty(ctypes.byref(self._state), image_of(config), t_max_degc, ms(now_s))
        return duty


class CRelays:
    """`vw_relays`."""

    def __init__(self) -> None:
        self._state = RelaysState()
        library().vw_relays_init(ctypes.byref(self._state), 0)

    @property
    def state(self) -> RelayState:
        """Which side the relays connect the accumulator to."""
        return list(RelayState)[self._state.state]

    @property
    def has_precharge_failed(self) -> bool:
        """The vehicle's link did not reach its voltage in time."""
        return bool(self._state.has_failed)

    @property
    def since_s(self) -> float:
        """When they came to their state."""
        return float(self._state.since_ms) / 1000

    def step(
        self, now_s: float, *, is_ok: bool, drive_requested: bool, charging: bool, link_share: float
    ) -> RelayState:
        """Advance one pass and return the state."""
        inputs = RelayInputs(is_ok, drive_requested, charging, int(link_share * 1000))
        library().vw_relays_step(ctypes.byref(self._state), ctypes.byref(inputs), ms(now_s))
        return self.state

    def retry(self) -> None:
        """Allow another try after a failed pre-charge."""
        library().vw_relays_retry(ctypes.byref(self._state))


class CounterState(ctypes.Structure):
    """`vw_soc_counter_t`."""

    _fields_ = (("dod", ctypes.c_uint32), ("rest", ctypes.c_uint16), ("is_started", ctypes.c_bool))


class CSocCounter:
    """`vw_soc_counter`."""

    def __init__(self) -> None:
        self._state = CounterState()
        library().vw_soc_counter_init(ctypes.byref(self._state))

    @property
    def dod_uah(self) -> int:
        """The charge drawn since full [uAh]."""
        return int(self._state.dod)

    @property
    def is_started(self) -> bool:
        """It counts."""
        return bool(self._state.is_started)

    def start_from_rest(self, config: Config, v_avg: int, i_fc: int) -> bool:
        """Start from the mean cell voltage [100 uV] without a current [10 mA]."""
        start = library().vw_soc_counter_from_rest
        return bool(start(ctypes.byref(self._state), image_of(config), v_avg, i_fc) & 0xFF)

    def start_from_journal(self, dod_uah: int) -> None:
        """Continue from a stored count."""
        library().vw_soc_counter_from_journal(ctypes.byref(self._state), dod_uah)

    def set_soc(self, config: Config, soc: int) -> None:
        """Set the counter by a SOC [0.01 %]."""
        library().vw_soc_counter_set(ctypes.byref(self._state), image_of(config), soc)

    def count(self, config: Config, i_fs: int) -> None:
        """Count one mean of `ts` samples of 1 ms [10 mA]."""
        library().vw_soc_counter_count(ctypes.byref(self._state), image_of(config), i_fs, config.ts)

    def soc_counts(self, config: Config) -> int:
        """Return the SOC [0.01 %]."""
        return library().vw_soc_counter_soc(ctypes.byref(self._state), image_of(config)) & 0xFFFF


class BalanceState(ctypes.Structure):
    """`vw_balance_t`."""

    _fields_ = (
        ("cells", ctypes.c_uint16 * N_PACKS),
        ("is_active", ctypes.c_bool),
        ("is_by_hand", ctypes.c_bool),
        ("by_hand_until_ms", ctypes.c_uint32),
    )


class ChargingStruct(ctypes.Structure):
    """`vw_charging_t`."""

    _fields_ = (
        ("master", ctypes.c_void_p),
        ("balance", ctypes.c_void_p),
        ("state", ctypes.c_int),
        ("is_active", ctypes.c_bool),
        ("is_slope_known", ctypes.c_bool),
        ("is_full", ctypes.c_bool),
        ("since_ms", ctypes.c_uint32),
        ("control_ms", ctypes.c_uint32),
        ("full_ms", ctypes.c_uint32),
        ("current", ctypes.c_double),
        ("slope", ctypes.c_double),
        ("rest_v", ctypes.c_uint16 * N_CELLS),
    )


class CBalancer:
    """The cells that `vw_balance` bleeds."""

    def __init__(self) -> None:
        self.state = BalanceState()
        library().vw_balance_init(ctypes.byref(self.state))

    @property
    def cells(self) -> np.ndarray:
        """One bool a cell."""
        return np.array([self.state.cells[k // CELLS_PER_PACK] >> k % CELLS_PER_PACK & 1 for k in range(N_CELLS)], bool)


class CCharging:
    """`vw_charging` on a struct."""

    def __init__(self, memory: MasterMemory, balancer: CBalancer) -> None:
        self._memory, self.balancer, self._struct = memory, balancer, ChargingStruct()
        self._image = (ctypes.c_char * MASTER_SIZE).from_buffer(memory.image)
        library().vw_charging_init(ctypes.byref(self._struct), ctypes.byref(self._image), ctypes.byref(balancer.state))

    @property
    def state(self) -> ChargingState:
        """The `charger.state` byte."""
        return ChargingState(self._struct.state)

    @property
    def is_active(self) -> bool:
        """The charge relays are closed."""
        return bool(self._struct.is_active)

    def start(self, now_s: float) -> list[EventMessage]:
        """Start charging."""
        return self._event(library().vw_charging_start(ctypes.byref(self._struct), ms(now_s)))

    def stop(self, now_s: float, *, fault: bool = False) -> list[EventMessage]:
        """Stop charging, on request or because of a fault."""
        return self._event(library().vw_charging_stop(ctypes.byref(self._struct), fault, ms(now_s)))

    def step(self, config: Config, now_s: float, *, charger_alive: bool, v_max: int) -> list[EventMessage]:
        """Advance one pass."""
        self._memory.image[:CONFIG_SIZE] = image_of(config)
        step = library().vw_charging_step
        return self._event(step(ctypes.byref(self._struct), charger_alive, v_max, ms(now_s)))

    def _event(self, has_changed: int) -> list[EventMessage]:
        state = int(self.state)
        return [EventMessage(EventCode.CHARGER_STATE, 0, NO_OFFSET, state, 0)] if has_changed & 0xFF else []
