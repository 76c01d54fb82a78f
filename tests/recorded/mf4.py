"""Bus logging in MF4, written by asammdf."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from firmware_protocol.memory_map import CAN_ID_EXTENDED
from tests.recorded.peer_sessions import START_S

NAMES = (("BusChannel", "u1"), ("ID", "<u4"), ("IDE", "u1"), ("DLC", "u1"), ("DataLength", "u1"))


def write_mf4(path: Path, *buses: list[tuple[float, int, bytes]], has_ide: bool = True) -> Path:
    """Write (seconds, id with bit 31 for 29-bit ones, data) of each bus as bus logging with a group a bus."""
    asammdf = pytest.importorskip("asammdf")  # here: with pandas it takes a third of a second of every test process
    blocks, constants = asammdf.blocks.v4_blocks, asammdf.blocks.v4_constants
    file = asammdf.MDF(version="4.11")
    file.start_time = datetime.fromtimestamp(START_S, UTC)
    names = [each for each in NAMES if has_ide or each[0] != "IDE"]
    dtype = np.dtype(
        [(f"CAN_DataFrame.{name}", kind) for name, kind in names] + [("CAN_DataFrame.DataBytes", "(64,)u1")]
    )
    for number, frames in enumerate(buses, 1):
        rows = np.zeros(len(frames), dtype)
        for row, (_, can_id, data) in zip(rows, frames, strict=True):
            row["CAN_DataFrame.BusChannel"] = number
            row["CAN_DataFrame.ID"] = can_id & ~CAN_ID_EXTENDED if has_ide else can_id
            if has_ide:
                row["CAN_DataFrame.IDE"] = bool(can_id & CAN_ID_EXTENDED)
            row["CAN_DataFrame.DataLength"] = len(data)
            row["CAN_DataFrame.DataBytes"][: len(data)] = list(data)
        times_s = np.array([time_s for time_s, _, _ in frames])
        source = blocks.SourceInformation(source_type=constants.SOURCE_BUS, bus_type=constants.BUS_TYPE_CAN)
        file.append(asammdf.Signal(rows, times_s, name="CAN_DataFrame", source=source))
    file.save(path, overwrite=True)
    file.close()
    return path
