"""A recorded drive as load and start state: a CSV file, for example an exported session.

A session has no sensor in the air. The air is taken to be as warm as the coldest cell has been so far: cells without
cooling below ambient are never colder than their air, and at the start of a day they are as warm as it is.
"""

import csv
import gzip
import math
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from simulator.cell_data import FloatArray
from simulator.errors import InputError, ParameterError
from simulator.inputs import AMBIENT_DEGC, CURRENT_A, SHARE, NumberRange, check_number
from simulator.loads import Recorded

_CURRENT_COLUMNS = (
    "current_a",
    "i_fc (A)",
    "i_fs (A)",
    "i_fc",
    "i_fs",
)  # ours first, then those of an exported session
_AMBIENT_COLUMNS = ("ambient_degc", "t_min (degC)", "t_min")
_SOC_COLUMNS = ("soc",)
_TIME_S = NumberRange(-1e11, 1e11, "s")  # since any beginning, 1970 among them
_SENSOR_DEGC = NumberRange(-128, 255, "degC")  # a broken one shows anything; as air it counts within AMBIENT_DEGC
_LIMITS = {
    "time_s": _TIME_S,
    **dict.fromkeys(_CURRENT_COLUMNS, CURRENT_A),
    **dict(zip(_AMBIENT_COLUMNS, (AMBIENT_DEGC, _SENSOR_DEGC, _SENSOR_DEGC), strict=True)),
    **dict.fromkeys(_SOC_COLUMNS, SHARE),
}


@dataclass(frozen=True, slots=True)
class RecordedDrive:
    """A drive and the state it began with; None where the file does not say."""

    time_s: FloatArray
    current_a: FloatArray
    ambient_degc: FloatArray | None
    start_soc: float | None  # 0..1


def read_recording(path: Path) -> RecordedDrive:
    """Read a CSV file (plain or .gz); rows without a current are skipped, repeated times keep the last one.

    Raises:
        ParameterError: it cannot be read, has no column for time or current, a value is no number or outside what it
            can be, time goes back, or there are fewer than two rows.
    """
    opener = gzip.open if path.suffix == ".gz" else open
    try:
        with opener(path, "rt", newline="", encoding="utf-8") as stream:
            rows = csv.DictReader(stream)
            names = list(rows.fieldnames or [])
            current = _first(_CURRENT_COLUMNS, names)
            if current is None or "time_s" not in names:
                raise ParameterError("columns", names, f"needs time_s and one of {', '.join(_CURRENT_COLUMNS)}")
            ambient, soc = _first(_AMBIENT_COLUMNS, names), _first(_SOC_COLUMNS, names)
            columns = [name for name in ("time_s", current, ambient, soc) if name is not None]
            values = list(_rows(rows, columns))
    except (OSError, EOFError, ValueError, zlib.error, csv.Error) as error:
        raise ParameterError("file", str(path), str(error)) from error
    except InputError as error:
        raise ParameterError("file", str(path), f"line {rows.line_num}: {error}") from error
    table = np.array(values, dtype=float).reshape(-1, len(columns))
    table = table[np.append(np.diff(table[:, 0]) > 0, True)[: len(table)]]
    if len(table) < 2:
        raise ParameterError("file", str(path), "needs two rows with a current, or more")
    by_name = dict(zip(columns, table.T, strict=True))
    return RecordedDrive(
        by_name["time_s"],
        by_name[current],
        None if ambient is None else _air(by_name[ambient], is_measured=ambient == _AMBIENT_COLUMNS[0]),
        None if soc is None else _first_known(by_name[soc]),
    )


def load_recording(path: Path) -> Recorded:
    """Return the drive as a load.

    Raises:
        ParameterError: as `read_recording`, or time does not increase.
    """
    recording = read_recording(path)
    return Recorded(recording.time_s, recording.current_a, recording.ambient_degc)


def _first(wanted: tuple[str, ...], names: list[str]) -> str | None:
    return next((name for name in wanted if name in names), None)


def _rows(rows: "csv.DictReader[str]", columns: list[str]) -> Iterator[list[float]]:
    """Yield the columns of each row that has a current, NaN for an empty value of one that may be."""
    last_s = -math.inf
    for row in rows:
        if not row[columns[1]]:
            continue
        values = [_number(name, row[name], may_be_empty=name not in columns[:2]) for name in columns]
        if values[0] < last_s:
            raise InputError("time_s", f"time_s = {values[0]!r} goes back, the row before has {last_s!r}")
        last_s = values[0]
        yield values


def _number(name: str, text: str | None, *, may_be_empty: bool) -> float:
    if not text and may_be_empty:
        return math.nan
    try:
        value = float(text or "")
    except ValueError:
        raise InputError(name, f"{name} = {text!r} is no number") from None
    return check_number(name, value, _LIMITS[name])


def _air(degc: FloatArray, *, is_measured: bool) -> FloatArray | None:
    """Return the air's temperature in every row, None where no row has one: gaps hold what was last known."""
    is_plausible = (degc >= AMBIENT_DEGC.minimum) & (degc <= AMBIENT_DEGC.maximum)
    if not is_plausible.any():
        return None
    if not is_measured:
        return np.minimum.accumulate(np.where(is_plausible, degc, degc[is_plausible.argmax()]))
    held = np.maximum.accumulate(np.where(is_plausible, np.arange(len(degc)), is_plausible.argmax()))
    return degc[held]


def _first_known(values: FloatArray) -> float | None:
    finite = values[np.isfinite(values)]
    return float(finite[0]) if len(finite) else None
