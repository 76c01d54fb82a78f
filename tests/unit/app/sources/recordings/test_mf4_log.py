"""Bus logging as asammdf writes it: several buses, 11 and 29 bits, classic CAN and CAN FD."""

import sys
from pathlib import Path

import numpy as np
import pytest

from app.errors import ExtraMissing, ImportFailed
from app.sources.recordings import mf4_log
from app.sources.recordings.can_log import read_frames
from firmware_protocol.memory_map import CAN_ID_EXTENDED
from tests.recorded.mf4 import write_mf4
from tests.recorded.peer_sessions import START_S


@pytest.mark.parametrize("has_ide", [True, False])
def test_frames_of_all_buses_come_in_the_order_of_time_with_their_bytes(tmp_path: Path, has_ide: bool) -> None:
    first = [(0.1, 0x123, b"\x01\x02"), (0.3, 0x18FF50E5 | CAN_ID_EXTENDED, bytes(8))]
    second = [(0.2, 0x7FF, bytes(range(64))), (0.4, 0x1, b"")]
    path = write_mf4(tmp_path / "run.mf4", first, second, has_ide=has_ide)
    found = list(read_frames(path))
    expected = sorted(first + second)
    assert [(can_id, data) for _, can_id, data in found] == [(can_id, data) for _, can_id, data in expected]
    assert [time_s for time_s, _, _ in found] == pytest.approx([START_S + time_s for time_s, _, _ in expected])


def test_a_file_without_frames_says_so(tmp_path: Path) -> None:
    import asammdf  # here: with pandas it takes half a second of every test process

    file = asammdf.MDF(version="4.11")
    file.append(asammdf.Signal(np.arange(3.0), np.arange(3.0), name="speed"))
    file.save(tmp_path / "run.mf4")
    file.close()
    with pytest.raises(ImportFailed, match="CAN_DataFrame"):
        list(read_frames(tmp_path / "run.mf4"))


def test_frames_come_in_pieces_and_none_is_lost_between_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mf4_log, "AT_ONCE", 3)
    frames = [(0.1 * k, 0x100 + k, bytes([k])) for k in range(8)]
    found = list(read_frames(write_mf4(tmp_path / "run.mf4", frames[::2], frames[1::2])))
    assert [(can_id, data) for _, can_id, data in found] == [(can_id, data) for _, can_id, data in frames]


def test_without_asammdf_the_line_to_install_it_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "asammdf", None)
    (tmp_path / "run.mf4").write_bytes(b"MDF ")
    with pytest.raises(ExtraMissing, match=r"pip install .*mf4"):
        list(read_frames(tmp_path / "run.mf4"))
