"""Made files of the two layouts that BTS writes most: version 29 of .nda, version 2 of the records in an .ndax."""

import struct
import warnings
import zipfile
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from app.errors import ExtraMissing, LimitExceeded
from app.sources.recordings import signal_files
from app.sources.recordings.battery_log import battery_log
from app.sources.recordings.csv_table import TableUnreadable
from app.sources.recordings.guess import guess
from app.sources.recordings.kind import kind_of
from app.sources.recordings.table import load_table
from app.words import render

pytest.importorskip("fastnda")
RANGE_MA, MA_OF_RANGE = 1000, 0.1  # a count of the current in that range is 0.1 mA
CHARGE, REST, DISCHARGE = 1, 4, 2
STEPS = [  # step, what, time in it [ms], voltage [0.1 mV], current [0.1 mA]
    (1, CHARGE, 0, 36_000, 15_000),
    (1, CHARGE, 500, 36_100, 15_000),
    (1, CHARGE, 1000, 36_200, 15_000),
    (2, REST, 500, 36_050, 0),
    (2, REST, 1000, 36_040, 0),
    (3, DISCHARGE, 250, 35_500, -20_000),
]
TIMES_S = [0.0, 0.5, 1.0, 1.5, 2.0, 2.25]
STARTED = datetime(2026, 5, 1, 12, 0, 0, tzinfo=UTC)


def stamp(k: int) -> bytes:
    return struct.pack("<HBBBBB", 2026, 5, 1, 12, 0, k // 2)


def nda(records: list[tuple[int, int, int, int, int]] = STEPS, version: int = 29) -> bytes:
    head = (b"NEWARE" + bytes(8) + bytes([version])).ljust(2304, b"\1") + bytes(4)
    rows = []
    for k, (step, what, ms, volts, amps) in enumerate(records):
        row = b"U\0" + struct.pack("<IIHB", k + 1, 0, step, what) + b"\0" + struct.pack("<Qii", ms, volts, amps)
        row = row.ljust(38, b"\0") + struct.pack("<qqqq", 0, 0, 0, 0) + stamp(k) + b"\0"
        rows.append((row + struct.pack("<i", RANGE_MA)).ljust(86, b"\0"))
    return head + b"".join(rows)


def ndax(path: Path, content: bytes | None = None) -> Path:
    rows = []
    for k, (step, what, ms, volts, amps) in enumerate(STEPS):
        row = b"U\1\2\3\4\5\6\7" + struct.pack("<IIBB", k + 1, 0, step, what)
        row = row.ljust(23, b"\0") + struct.pack("<Qii", ms, volts, amps)
        row = row.ljust(43, b"\0") + struct.pack("<qqqq", 0, 0, 0, 0) + stamp(k) + struct.pack("<i", RANGE_MA)
        rows.append(row.ljust(94, b"\0"))
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed:
        blocks = [(bytes(5) + b"".join(rows[first : first + 5])).ljust(512, b"\0") for first in range(0, len(rows), 5)]
        whole = b"\1\0\2".ljust(512, b"\0") + b"".join(blocks)
        packed.writestr("data.ndc", whole if content is None else content)
    return path


@pytest.mark.parametrize("kind", ["nda", "ndax"])
def test_the_time_of_the_steps_becomes_that_of_the_test(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "cell.dat"  # known by its content
    if kind == "nda":
        path.write_bytes(nda())
    else:
        ndax(path)
    assert kind_of(path) == kind
    table = load_table(path)
    log = battery_log(table, guess(table))
    assert log.started_unix_s == STARTED.timestamp()
    np.testing.assert_allclose(log.time_s, TIMES_S, atol=1e-6)
    np.testing.assert_allclose(log.current_a, [-1.5, -1.5, -1.5, 0, 0, 2.0])  # positive on discharge
    np.testing.assert_allclose(log.voltages_v[:, 0], [3.6, 3.61, 3.62, 3.605, 3.604, 3.55], rtol=1e-6)


def test_a_temperature_beside_the_cell_is_taken(tmp_path: Path) -> None:
    path = tmp_path / "warm.nda"
    aux = b"".join(
        (b"\x65" + struct.pack("<BI", 1, k + 1)).ljust(34, b"\0") + struct.pack("<h", 215 + k) + bytes(50)
        for k in range(len(STEPS))
    )
    path.write_bytes(nda() + aux)
    table = load_table(path)
    log = battery_log(table, guess(table))
    np.testing.assert_allclose(log.temperatures_degc[:, 0], 21.5 + 0.1 * np.arange(len(STEPS)), rtol=1e-6)


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (nda(version=99), "version 99 is not yet supported"),
        (nda([]), "start of data"),
        (nda()[:12], "cannot be read"),
    ],
)
def test_what_cannot_be_read_is_refused_with_the_export_that_can(tmp_path: Path, content: bytes, why: str) -> None:
    path = tmp_path / "old.nda"
    path.write_bytes(content)
    with pytest.raises(TableUnreadable, match=rf"old\.nda: .*{why}.*export it as CSV or xlsx from BTSDA"):
        load_table(path)


@pytest.mark.parametrize("content", [b"", b"\1\0\2", b"\1\0\x63" + bytes(600), bytes(9000)])
def test_a_damaged_ndax_is_refused(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(TableUnreadable, match="export it as CSV or xlsx from BTSDA"):
        load_table(ndax(tmp_path / "bad.ndax", content))


def test_a_file_beyond_the_limit_is_not_begun(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(signal_files, "MOST_BYTES", 1 << 20)
    packed = ndax(tmp_path / "large.ndax", bytes(2 << 20))
    assert packed.stat().st_size < 1 << 16
    plain = tmp_path / "large.nda"
    plain.write_bytes(nda().ljust(2 << 20, b"\0"))
    for path in (packed, plain):
        with pytest.raises(LimitExceeded, match="more than 1 MB"):
            load_table(path)


def test_without_the_library_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "cell.nda"
    path.write_bytes(nda())

    def missing(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(signal_files, "import_module", missing)
    with pytest.raises(ExtraMissing, match=r"voltwall\[neware\]"):
        load_table(path)


def test_what_the_reader_remarks_is_a_note(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read = signal_files._reader("nda")

    def remarking(path: Path) -> object:
        warnings.warn("nda version 29 is unverified", stacklevel=1)
        return read(path)

    monkeypatch.setattr(signal_files, "_reader", lambda kind: remarking)
    path = tmp_path / "cell.nda"
    path.write_bytes(nda())
    assert [render(note) for note in load_table(path).notes] == [
        "note of the file reader: nda version 29 is unverified"
    ]
