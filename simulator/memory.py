"""The master's struct as the firmware holds it: 2984 bytes, and typed windows onto them.

Every value of the virtual master lives here, at the place that the memory map gives it, and nowhere else on the wire.
"""

import struct
from dataclasses import dataclass, fields
from typing import Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.memory_map import (
    CHARGER_FIELDS,
    CHARGER_OFFSET,
    CONFIG,
    CONFIG_SIZE,
    FIELDS,
    MASTER_SIZE,
    N_PACKS,
    SLAVE_FIELDS,
    SLAVE_OFFSET,
    SLAVE_SIZE,
    STATUS_FLAGS,
    STATUS_OFFSET,
    T_MISSING,
)

Scalar = TypeVar("Scalar", bound=np.generic)

_FLAGS = struct.Struct("<I")
_MASKS = struct.Struct("<3B")
_CURRENTS = struct.Struct("<3i")
_VOLTAGE_SUMMARY = struct.Struct("<3H2BH")
_TEMPERATURE_SUMMARY = struct.Struct("<3b2B")
_CAPACITY_SUMMARY = struct.Struct("<5H")
_CAPACITY_OFFSET = FIELDS["c_min"].offset
_U16 = struct.Struct("<H")
_U32 = struct.Struct("<I")
_CHARGER = {field.name: (CHARGER_OFFSET + field.offset, struct.Struct(f"<{field.fmt}")) for field in CHARGER_FIELDS}
_SLAVE = {field.name: field for field in SLAVE_FIELDS}
_MASK_OFFSET = FIELDS["status.can_tx_msg_en"].offset
_CHARGER_STATUS_OFFSET = FIELDS["status.charger_status"].offset
_CURRENT_OFFSET = FIELDS["i_fs"].offset
_VOLTAGE_SUMMARY_OFFSET = FIELDS["v_min"].offset
_TEMPERATURE_SUMMARY_OFFSET = FIELDS["t_min"].offset
_DOD_OFFSET = FIELDS["dod"].offset
_SOC_OFFSET = FIELDS["soc"].offset
_N_SLAVES_OFFSET = FIELDS["n_slaves"].offset
FLAG = {name: 1 << bit for bit, name in enumerate(STATUS_FLAGS)}


@dataclass(frozen=True, slots=True)
class Config:
    """The scalars of the configuration in force, in the memory map's counts."""

    ts: int
    v_cell_min: int
    v_cell_max: int
    v_cell_chrg: int
    t_cell_min: int
    t_cell_max: int
    i_offset: int
    i_gain: int
    i_disc_min: int
    i_disc_max: int
    i_chrg_min: int
    i_chrg_max: int
    c_avg: int
    r_fs_avg: int
    r_fc_avg: int
    fc_avg: int
    fan_ramp_start: int
    fan_ramp_stop: int
    fan_ramp_min: int
    fan_ramp_max: int
    balance_threshold: int
    v_alpha: int
    can_brp: int
    can_tx_msg_en_startup: int
    can_rx_msg_en_startup: int
    telemetry_period: int

    @classmethod
    def from_image(cls, image: bytes | bytearray) -> Self:
        """Read the scalars out of an image that starts with the configuration."""
        return cls(*(CONFIG[field.name].unpack(image)[0] for field in fields(cls)))


class MasterMemory:
    """The struct; the arrays are views of it, so writing them is writing the struct."""

    def __init__(self) -> None:
        self.image = bytearray(MASTER_SIZE)
        self.v: NDArray[np.uint16] = self._array("v", np.uint16)
        self.ocv: NDArray[np.uint16] = self._array("ocv", np.uint16)
        self.t: NDArray[np.int8] = self._array("t", np.int8)
        self.c: NDArray[np.uint16] = self._array("c", np.uint16)
        self.r_fs: NDArray[np.uint16] = self._array("r_fs", np.uint16)
        self.r_fc: NDArray[np.uint16] = self._array("r_fc", np.uint16)
        self.slave_status: NDArray[np.uint8] = self._slaves("status", np.uint8)[:, 0]
        self.slave_time: NDArray[np.uint32] = self._slaves("time", np.uint32)
        self.slave_cfgr: NDArray[np.uint8] = self._slaves("cfgr", np.uint8)
        self.slave_cvr: NDArray[np.uint16] = self._slaves("cvr", np.uint16)
        self.slave_avr: NDArray[np.uint16] = self._slaves("avr", np.uint16)
        self.slave_str: NDArray[np.uint16] = self._slaves("str", np.uint16)
        self.slave_com: NDArray[np.uint16] = self._slaves("com", np.uint16)
        self.slave_temp: NDArray[np.uint16] = self._slaves("temp", np.uint16)
        self.t[:] = T_MISSING

    def _array(self, name: str, dtype: type[Scalar]) -> NDArray[Scalar]:
        field = FIELDS[name]
        return np.frombuffer(self.image, np.dtype(dtype).newbyteorder("<"), field.count, field.offset)

    def _slaves(self, name: str, dtype: type[Scalar]) -> NDArray[Scalar]:
        field = _SLAVE[name]
        return np.ndarray(
            (N_PACKS, field.count),
            np.dtype(dtype).newbyteorder("<"),
            self.image,
            SLAVE_OFFSET + field.offset,
            (SLAVE_SIZE, field.item_size),
        )

    @property
    def config(self) -> bytes:
        """The 420 bytes of the configuration in force."""
        return bytes(self.image[:CONFIG_SIZE])

    @config.setter
    def config(self, image: bytes) -> None:
        self.image[:CONFIG_SIZE] = image

    @property
    def flags(self) -> int:
        """The status bits."""
        return int(_FLAGS.unpack_from(self.image, STATUS_OFFSET)[0])

    @flags.setter
    def flags(self, flags: int) -> None:
        _FLAGS.pack_into(self.image, STATUS_OFFSET, flags)

    def set_can_masks(self, tx_enabled: int, rx_enabled: int, rx_active: int) -> None:
        """Write which messages are sent, listened for and alive."""
        _MASKS.pack_into(self.image, _MASK_OFFSET, tx_enabled, rx_enabled, rx_active)

    def set_charger_status(self, status: int) -> None:
        """Write the charger's last flags."""
        self.image[_CHARGER_STATUS_OFFSET] = status

    def charger(self, name: str) -> int:
        """Return one field of the charger struct."""
        offset, code = _CHARGER[name]
        return int(code.unpack_from(self.image, offset)[0])

    def set_charger(self, name: str, value: int) -> None:
        """Write one field of the charger struct."""
        offset, code = _CHARGER[name]
        code.pack_into(self.image, offset, value)

    def set_currents(self, i_fs: int, i_fc: int, i_fc_hp: int) -> None:
        """Write the three currents [10 mA]."""
        _CURRENTS.pack_into(self.image, _CURRENT_OFFSET, i_fs, i_fc, i_fc_hp)

    def set_voltage_summary(self, v_min: int, v_max: int, v_avg: int, min_id: int, max_id: int, v_tot: int) -> None:
        """Write lowest, highest and mean cell voltage [100 uV], their cells, and the sum [10 mV]."""
        _VOLTAGE_SUMMARY.pack_into(self.image, _VOLTAGE_SUMMARY_OFFSET, v_min, v_max, v_avg, min_id, max_id, v_tot)

    def set_temperature_summary(self, t_min: int, t_max: int, t_avg: int, min_id: int, max_id: int) -> None:
        """Write coldest, hottest and mean cell [degC] and their cells."""
        _TEMPERATURE_SUMMARY.pack_into(self.image, _TEMPERATURE_SUMMARY_OFFSET, t_min, t_max, t_avg, min_id, max_id)

    def set_charge(self, dod: int, soc: int) -> None:
        """Write the charge drawn [uAh] and the state of charge [0.01 %]."""
        _U32.pack_into(self.image, _DOD_OFFSET, dod)
        _U16.pack_into(self.image, _SOC_OFFSET, soc)

    def set_capacity_summary(self, capacity: int) -> None:
        """Write one capacity [10 mAh] as lowest, highest and mean, of cell 0."""
        _CAPACITY_SUMMARY.pack_into(self.image, _CAPACITY_OFFSET, capacity, capacity, capacity, 0, 0)

    def set_slave_count(self, n_slaves: int) -> None:
        """Write how many slaves answered."""
        self.image[_N_SLAVES_OFFSET] = n_slaves
