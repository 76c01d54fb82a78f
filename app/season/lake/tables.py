"""Tables as Parquet files: types, units and meanings of `schema` in the metadata of the columns."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np

from app import __version__
from app.season.lake.facts import Row, Where
from app.season.lake.schema import LAKE_VERSION, TABLES, WHERE, LakeColumn, arrow_schema, pyarrow_or_error
from app.sessions.export.table import SignalTable
from app.sessions.reading.reader import SessionFile

VERSION_KEY: Final = b"voltwall_lake"
STATE_KEY: Final = b"source_state"
ROW_GROUP_S: Final = 600.0
_LEFT_IN_SESSION: Final = ("conf.", "slave[")  # images in force, and the boards' raw registers


def about(where: Where, state: str) -> dict[str, str]:
    """Return the key-value metadata of every file of a session."""
    made_by = {VERSION_KEY.decode(): str(LAKE_VERSION), "voltwall": __version__, STATE_KEY.decode(): state}
    return made_by | {"session": where.session}


def write_facts(path: Path, name: str, rows: Sequence[Row], metadata: dict[str, str]) -> None:
    """Write one table of facts."""
    pa = pyarrow_or_error()
    from pyarrow import parquet

    columns = TABLES[name]
    schema = arrow_schema(columns, metadata)
    arrays = [
        _array(pa, [row.get(column.name) for row in rows], column, schema.field(column.name).type) for column in columns
    ]
    parquet.write_table(pa.Table.from_arrays(arrays, schema=schema), path, compression="zstd")


def _array(pa: Any, values: list[Any], column: LakeColumn, wanted: Any) -> Any:
    if column.type == "number":  # NaN is null
        return pa.array(np.array(values, dtype=np.float64), wanted, from_pandas=True)
    if column.type == "count":
        values = [None if value is None or value != value else int(value) for value in values]
    return pa.array(values, wanted)


def sample_signals(session: SessionFile) -> list[str]:
    """Return the signals of the wide table, in their usual order."""
    present = [name for name in session.signal_names() if not name.startswith(_LEFT_IN_SESSION)]
    usual = [signal.name for signal in session.signals.of_table() if signal.field in set(present)]
    return list(dict.fromkeys([*usual, *(name for field in present for name in session.signals.names(field))]))


def sample_table(session: SessionFile) -> SignalTable:
    """Return what the wide table of a session is written from."""
    return SignalTable(session, sample_signals(session) or None)


def layout_of(table: SignalTable) -> str:
    """Return what is the same where two sessions have the same columns in their wide tables."""
    return hashlib.sha256("\n".join(signal.name for signal in table.signals).encode()).hexdigest()[:12]


def write_samples(path: Path, table: SignalTable, where: Where, metadata: dict[str, str]) -> None:
    """Write the wide table. Read and written piece by piece, so that memory does not grow with the session.

    Values are float32: to seven digits, which is more than any sensor has. Their bytes are split into streams before
    zstd: a third smaller than dictionaries of the same values, and no slower.
    """
    pa = pyarrow_or_error()
    from pyarrow import parquet

    names = [signal.name for signal in table.signals]
    fields = [
        *arrow_schema(WHERE),
        pa.field("time", pa.timestamp("us", "UTC"), metadata={"unit": "", "meaning": "when it was recorded"}),
        *(
            pa.field(signal.name, pa.float32(), metadata={"unit": "" if signal.unit == "1" else signal.unit})
            for signal in table.signals
        ),
    ]
    schema = pa.schema(fields, metadata=metadata)
    options: dict[str, Any] = {"compression": "zstd", "compression_level": 1}
    options |= {"use_dictionary": [field.name for field in WHERE], "use_byte_stream_split": names}
    options |= {"column_encoding": {"time": "DELTA_BINARY_PACKED"}, "write_statistics": ["time"]}
    with parquet.ParquetWriter(path, schema, **options) as writer:
        for times_us, values in _pieces(table):
            n = len(times_us)
            constant = [pa.repeat(text, n) for text in asdict(where).values()]
            times = pa.array(times_us, pa.timestamp("us", "UTC"))
            columns = [pa.array(column, from_pandas=True) for column in values]
            writer.write_batch(pa.record_batch([*constant, times, *columns], schema=schema))


def _pieces(table: SignalTable) -> Iterator[tuple[Any, Any]]:
    """(n,) microseconds of unix time and (k, n) float32, NaN where not sampled."""
    for rows in table.rows(ROW_GROUP_S, np.float32):
        yield np.round(rows.time_s * 1e6).astype(np.int64), rows.values.T  # each signal's values side by side
