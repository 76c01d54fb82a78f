import struct
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.sources.recordings.csv_table import TableUnreadable
from app.sources.recordings.guess import guess
from app.sources.recordings.signal_files import read_signals
from app.sources.recordings.table import load_table
from tests.campaign import examples


def test_the_groups_of_a_foreign_mf4_come_at_the_times_of_the_quickest(tmp_path: Path) -> None:
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version="4.10") as file:
        quick, slow = np.arange(0.0, 2.0, 0.5), np.array([0.4, 1.4])
        file.append([asammdf.Signal(np.array([1.0, 2.0, 3.0, 4.0]), quick, name="PackCurrent", unit="A")])
        cells = [asammdf.Signal(np.array([3.6, 3.7]), slow, name=f"Cell{n}_V", unit="V") for n in (1, 2)]
        file.append(cells)
        file.save(tmp_path / "run.bin.mf4")
    table = load_table((tmp_path / "run.bin.mf4").rename(tmp_path / "run.bin"))
    np.testing.assert_allclose(np.diff(table.columns["time_s"]), 0.5)
    np.testing.assert_array_equal(table.columns["Cell1_V (V)"], [np.nan, 3.6, 3.6, 3.7])
    profile = guess(table)
    assert (profile.current, profile.voltages) == ("PackCurrent (A)", "Cell{n}_V (V)")


@pytest.mark.parametrize("kind", ["mcap", "ld"])  # asammdf complains when it is collected
def test_a_file_that_only_begins_as_one_is_refused_by_name(tmp_path: Path, kind: str) -> None:
    magic = {"mcap": b"\x89MCAP0\r\n", "ld": b"\x40" + bytes(7)}[kind]
    (tmp_path / "cut").write_bytes(magic + bytes(20))
    with pytest.raises(TableUnreadable, match="cut: "):
        load_table(tmp_path / "cut")


@settings(max_examples=examples(30))
@given(st.binary(max_size=400))
def test_any_bytes_are_an_ld_or_a_reason(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "any.ld"
    path.write_bytes(content)
    with suppress(TableUnreadable):
        read_signals(path, "ld")


HEADER_SIZE, CHANNEL_SIZE = 0x6E2, 124  # bytes of MoTeC's header and of one channel in the chain
FLOAT32, INT16 = (7, 4, "<f4"), (3, 2, "<i2")


def ld_of(*channels: tuple[str, str, int, tuple[int, int, str], list[float], int], loops: bool = False) -> bytes:
    """Return an .ld of channels: name, unit, rate [Hz], type, raw values, decimal places; `loops`: without end."""
    header = bytearray(HEADER_SIZE)
    header[:12] = struct.pack("<I4xI", 0x40, HEADER_SIZE if channels else 0)
    header[94:104], header[126:134] = b"23/11/2026", b"10:20:30"
    chain, data = b"", b""
    data_at = HEADER_SIZE + CHANNEL_SIZE * len(channels)
    for k, (name, unit, rate, (kind, size, code), values, decimals) in enumerate(channels):
        is_last = k == len(channels) - 1
        following = HEADER_SIZE if loops and is_last else 0 if is_last else HEADER_SIZE + CHANNEL_SIZE * (k + 1)
        texts = (text.encode("latin-1") for text in (name, name[:8], unit))
        numbers = (0, following, data_at + len(data), len(values), 0, kind, size, rate, 0, 1, 1, decimals)
        chain += struct.pack("<4I4H4h32s8s12s40x", *numbers, *texts)
        data += np.array(values, code).tobytes()
    return bytes(header) + chain + data


def ld_columns(tmp_path: Path, content: bytes) -> dict[str, np.ndarray]:
    (tmp_path / "run.ld").write_bytes(content)
    return read_signals(tmp_path / "run.ld", "ld")


def test_channels_of_a_foreign_ld_come_at_the_quickest_rate_from_the_start_that_it_names(tmp_path: Path) -> None:
    columns = ld_columns(
        tmp_path,
        ld_of(
            ("Pack Current", "A", 4, FLOAT32, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0], 0),
            ("Cell 1", "V", 2, INT16, [3700, 3600, 3500], 3),
            ("Cell Temp", "C", 1, INT16, [250, 260], 1),
        ),
    )
    start_s = datetime(2026, 11, 23, 10, 20, 30, tzinfo=UTC).timestamp()
    np.testing.assert_allclose(columns["time_s"], start_s + np.arange(8) / 4)
    np.testing.assert_array_equal(columns["Pack Current (A)"], np.arange(1.0, 9.0))
    np.testing.assert_allclose(columns["Cell 1 (V)"], [3.7, 3.7, 3.6, 3.6, 3.5, 3.5, np.nan, np.nan])
    np.testing.assert_allclose(columns["Cell Temp (degC)"], [25.0] * 4 + [26.0] * 4)
    assert "elapsed_s" not in columns, "that is a column of our own files"


def test_a_chain_of_channels_that_bites_its_tail_ends(tmp_path: Path) -> None:
    columns = ld_columns(tmp_path, ld_of(("I", "A", 1, FLOAT32, [1.0], 0), loops=True))
    assert sorted(columns) == ["I (A)", "time_s"]


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (ld_of(), "no numeric signal"),
        (ld_of(("I", "A", 0, FLOAT32, [1.0], 0)), "no numeric signal"),  # a channel without a rate
        (ld_of(("I", "A", 1, (9, 9, "<f4"), [1.0], 0)), "cannot be read"),  # an unknown type
        (ld_of(("I", "A", 1, FLOAT32, [1.0, 2.0], 0))[:-3], "cannot be read"),  # cut off
    ],
)
def test_an_ld_without_a_signal_is_refused_with_its_name(tmp_path: Path, content: bytes, reason: str) -> None:
    with pytest.raises(TableUnreadable, match="run") as refused:
        ld_columns(tmp_path, content)
    assert reason in str(refused.value)
