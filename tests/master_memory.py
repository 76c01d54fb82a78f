"""The master's struct as tests look at it: typed windows onto its 2984 bytes."""

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
_CHARGER = {field.name: (CHARGER_OFFSET + field.offset, struct.Struct(f"<{field.fmt}")) for field in CHARGER_FIELDS}
_SLAVE = {field.name: field for field in SLAVE_FIELDS}
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
    """The struct of a master, or one that is empty; the arrays are views, so writing them is writing the struct."""

    def __init__(self, image: bytearray | memoryview | None = None) -> None:
        self.image = bytearray(MASTER_SIZE) if image is None else image
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
        if image is None:
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

    def charger(self, name: str) -> int:
        """Return one field of the charger struct."""
        offset, code = _CHARGER[name]
        return int(code.unpack_from(self.image, offset)[0])

    def set_charger(self, name: str, value: int) -> None:
        """Write one field of the charger struct."""
        offset, code = _CHARGER[name]
        code.pack_into(self.image, offset, value)
