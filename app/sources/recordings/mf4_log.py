"""CAN frames out of MF4 bus logging, classic and FD, of any logger that asammdf reads.

python-can reads such files message by message, and only where asammdf was there when it was loaded, which the service
avoids (see app/sources/links/can_bus.py).
"""

from collections.abc import Iterator
from heapq import merge
from importlib import import_module
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from app.errors import ExtraMissing
from firmware_protocol.memory_map import CAN_ID_EXTENDED

AT_ONCE = 20_000  # frames
_FRAME = "CAN_DataFrame"
_ID_BITS = 0x1FFFFFFF
Frame = tuple[float, int, bytes, str]  # and the bus


def mf4_frames(path: Path) -> Iterator[Frame]:
    """Yield the data frames of all buses of a file, in the order of their time.

    Raises:
        ExtraMissing: asammdf is not installed.
        Exception: asammdf cannot read the file; it has errors of many kinds.
        ValueError: the file holds no CAN frames.
    """
    try:
        asammdf = import_module("asammdf")
    except ImportError as error:
        raise ExtraMissing("an MF4 log", "asammdf", "mf4") from error
    with asammdf.MDF(path) as file:
        groups = [
            number
            for number, group in enumerate(file.groups)
            if group.channel_group.cycles_nr and any(channel.name == _FRAME for channel in group.channels)
        ]
        if not groups:
            raise ValueError(f"no {_FRAME} in it")
        start_s = file.start_time.timestamp()
        yield from merge(*(_frames_of(file, number, start_s) for number in groups), key=itemgetter(0))


def _frames_of(file: Any, number: int, start_s: float) -> Iterator[Frame]:
    """The frames of one channel group."""
    n_frames = file.groups[number].channel_group.cycles_nr
    for first in range(0, n_frames, AT_ONCE):
        columns = file.get(_FRAME, group=number, raw=True, record_offset=first, record_count=AT_ONCE)
        column = {name.rpartition(".")[2]: columns.samples[name] for name in columns.samples.dtype.names}
        can_id = column["ID"].astype(np.uint32)
        extended = (can_id & CAN_ID_EXTENDED != 0) | (column["IDE"] != 0 if "IDE" in column else False)
        ids = (can_id & _ID_BITS) | np.where(extended, np.uint32(CAN_ID_EXTENDED), np.uint32(0))
        times_s, lengths = columns.timestamps + start_s, column["DataLength"].astype(int)
        buses = column["BusChannel"].astype(int).tolist() if "BusChannel" in column else [""] * len(ids)
        rows = zip(times_s.tolist(), ids.tolist(), column["DataBytes"], lengths.tolist(), buses, strict=True)
        for time_s, frame_id, data, length, bus in rows:
            yield time_s, frame_id, bytes(data[:length]), str(bus)
