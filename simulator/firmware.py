"""The master's firmware of `firmware_protocol/c` as a shared library, and what it shares with Python.

The layouts repeat those of `simulated/vw_simulated.h`; their sizes are compared when it is loaded.
"""

import ctypes
from ctypes import c_bool, c_size_t, c_uint8, c_uint16, c_uint32, c_void_p
from functools import cache
from pathlib import Path
from typing import Final

from firmware_protocol.c_library import C_FOLDER, SUFFIX, open_library
from firmware_protocol.errors import LibraryError
from firmware_protocol.framing import MAX_ENCODED
from firmware_protocol.memory_map import CELLS_PER_PACK, MASTER_SIZE, N_PACKS
from simulator.errors import FirmwareError

LIBRARY: Final = C_FOLDER / "simulated" / f"vw_firmware{SUFFIX}"
MAX_SAMPLES: Final = 4000
MAX_CAN_FRAMES: Final = 64
PACKETS: Final = (N_PACKS, 4, 4)  # slaves, groups, words of a packet

Transfer = ctypes.CFUNCTYPE(None, c_uint32, c_void_p, c_size_t, c_void_p, c_size_t)
ReadRow = ctypes.CFUNCTYPE(c_bool, c_uint32, c_uint8)
EepromRead = ctypes.CFUNCTYPE(None, c_uint16, c_void_p, c_uint16)
EepromWrite = ctypes.CFUNCTYPE(None, c_uint32, c_uint16, c_void_p, c_uint16)
EepromIsBusy = ctypes.CFUNCTYPE(c_bool, c_uint32)
SensorInputs = c_uint8 * CELLS_PER_PACK


class BoardStruct(ctypes.Structure):
    """`vw_simulated_board_t`."""

    _fields_ = (
        ("transfer", Transfer),
        ("read_row", ReadRow),
        ("eeprom_read", EepromRead),
        ("eeprom_write", EepromWrite),
        ("eeprom_is_busy", EepromIsBusy),
    )


class CanFrameStruct(ctypes.Structure):
    """`vw_can_frame_t`."""

    _fields_ = (("id", c_uint32), ("is_extended", c_bool), ("length", c_uint8), ("data", c_uint8 * 8))


class IoStruct(ctypes.Structure):
    """`vw_simulated_io_t`."""

    _fields_ = (
        ("memory", c_uint8 * MASTER_SIZE),
        ("packets", c_uint16 * (PACKETS[0] * PACKETS[1] * PACKETS[2])),
        ("samples", c_uint16 * MAX_SAMPLES),
        ("hardware", c_uint32),
        ("link_permille", c_uint16),
        ("is_drive_asked", c_bool),
        ("is_shutdown_closed", c_bool),
        ("is_open", c_bool),
        ("is_charging", c_bool),
        ("has_precharge_failed", c_bool),
        ("is_streaming", c_bool),
        ("is_restarting", c_bool),
        ("has_line_due", c_bool),
        ("relays", c_uint8),
        ("charging", c_uint8),
        ("n_can", c_uint8),
        ("relays_since_ms", c_uint32),
        ("line_due_ms", c_uint32),
        ("can", CanFrameStruct * MAX_CAN_FRAMES),
        ("frame", c_uint8 * (MAX_ENCODED + 2)),
    )


def sources() -> list[Path]:
    """Return the C files and headers that the library is made of."""
    folders = (C_FOLDER, C_FOLDER / "master", C_FOLDER / "simulated")
    return [path for folder in folders for path in sorted(folder.glob("v*.[ch]"))]


@cache
def load() -> ctypes.PyDLL:
    """Return the library.

    Raises:
        FirmwareError: there is none for this machine, or it was built from other sources than these.
    """
    try:
        library = open_library(LIBRARY, sources())
    except LibraryError as error:
        raise FirmwareError(str(error)) from error
    for name in ("size", "io_size", "next"):
        getattr(library, f"vw_simulated_{name}").restype = c_size_t
    for name in ("command", "store"):
        getattr(library, f"vw_simulated_{name}").restype = c_uint8
    if library.vw_simulated_io_size() != ctypes.sizeof(IoStruct):
        raise FirmwareError(f"{LIBRARY.name} has another memory layout: {library.vw_simulated_io_size()}")
    return library
