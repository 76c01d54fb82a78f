"""A slave's readings against a reference meter: which cells are further off than the board may be, and what that means.

Nothing is corrected: the converter has no trim, and a number bent here would not be the one on which the master trips.
What is out of tolerance is repaired and checked again; the errors before are kept next to those after.
"""

import math
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

from app.configuration.history import JsonLines
from app.errors import ConfigError, NotNow
from app.sources.data_file import checked, parse_object
from app.sources.master.client import MasterClient, read_field
from app.words import Message, Pack
from firmware_protocol.memory_map import CELLS_PER_PACK, CHIP_MISSING, FIELDS, N_PACKS, T_MISSING

SAMPLES = 20
PERIOD_S = 0.05
REST_A = 2.0  # more than the sensor's noise; with current, meter and slave see different instants
STEADY = 3.0  # times the tolerance that a reading may scatter
_ACTIVE = 1

QuantityName = Literal["voltage", "temperature"]
Cause = Literal["none", "reference", "wire", "cells"]


@dataclass(frozen=True, slots=True)
class CheckedQuantity:
    """A quantity that is compared; `tolerance` is the slave's own, in `unit`."""

    unit: str
    tolerance: float
    lowest: float
    highest: float
    meter_error_max: float  # beyond it the meter cannot judge the slave


QUANTITIES: dict[QuantityName, CheckedQuantity] = {
    # LTC6804 data sheet, page 1: total measurement error at most 1.2 mV
    "voltage": CheckedQuantity("V", 1.2e-3, 0.5, 5.0, 5e-3),
    # half a count of the master (0.5 K), half a digit of the sensor's table (0.8 K at 60 degC), the rest the sensor's
    "temperature": CheckedQuantity("degC", 2.0, -40.0, 100.0, 2.0),
}


@dataclass(frozen=True, slots=True)
class CellReading:
    """One cell by its slave, averaged; None where it has no measurement. `sigma` of one sample."""

    cell: int  # 0..95
    value: float | None
    sigma: float | None


@dataclass(frozen=True, slots=True)
class CheckedCell:
    """A reading and the meter's; `is_good` None where one of them is missing."""

    cell: int
    value: float | None
    sigma: float | None
    reference: float | None
    error: float | None  # reading minus reference
    is_good: bool | None


@dataclass(frozen=True, slots=True)
class SlaveVerdict:
    """The verdict on the errors of a slave; `share` is the common error where the cause is the reference."""

    cells: tuple[CheckedCell, ...]
    cause: Cause
    out: tuple[int, ...]  # cells out of tolerance
    share: float | None
    limit: float  # tolerance and the meter's own error together


def read_slave(
    master: MasterClient, pack: int, quantity: QuantityName, *, sleep: Callable[[float], None] = time.sleep
) -> list[CellReading]:
    """Average what a slave measures over a second; voltages as its converter gives them, not filtered.

    Raises:
        NotNow: the slave does not answer, a current flows, or cells of the pack are being bled.
        LinkError: the master cannot be asked.
    """
    _require_rest(master, pack)
    samples: list[list[float]] = [[] for _ in range(CELLS_PER_PACK)]
    for _ in range(SAMPLES):
        for readings, value in zip(samples, _sample(master, pack, quantity), strict=True):
            readings += [] if value is None else [value]
        sleep(PERIOD_S)
    _require_rest(master, pack)
    return [_averaged(pack * CELLS_PER_PACK + i, values) for i, values in enumerate(samples)]


def judge(
    readings: Sequence[CellReading], reference: Sequence[float | None], quantity: QuantityName, meter_error: float
) -> SlaveVerdict:
    """Return the error of each cell, which are out of tolerance, and what they have in common.

    Args:
        readings: of one slave, in order.
        reference: the meter's, one a reading, None where none was taken.
        quantity: which.
        meter_error: what the meter itself may be off [V or degC].

    Raises:
        ConfigError: a reference or the meter is beyond what can be; names the field.
        NotNow: a reading is not steady.
    """
    limits = QUANTITIES[quantity]
    if len(reference) != len(readings) or all(value is None for value in reference):
        given, limit_of_count = Message("values", count=len(reference)), Message("one-a-number", count=len(readings))
        raise ConfigError("reference", given, limit_of_count)
    if not 0 <= meter_error <= limits.meter_error_max:
        most = Message("meter-too-far", bounds=f"0..{limits.meter_error_max:g} {limits.unit}")
        raise ConfigError("meter_error", meter_error, most)
    limit = limits.tolerance + meter_error
    cells = tuple(_checked(r, value, limits, limit) for r, value in zip(readings, reference, strict=True))
    if all(cell.error is None for cell in cells):
        raise ConfigError("reference", Message("given"), Message("measured-cell"))
    out = tuple(cell.cell for cell in cells if cell.is_good is False)
    cause, share = _cause(cells, limit, quantity)
    return SlaveVerdict(cells, cause, out, share, limit)


def _checked(reading: CellReading, reference: float | None, limits: CheckedQuantity, limit: float) -> CheckedCell:
    if reference is None or reading.value is None:
        return CheckedCell(reading.cell, reading.value, reading.sigma, reference, None, None)
    if not limits.lowest <= reference <= limits.highest:
        field = f"reference[{reading.cell % CELLS_PER_PACK}]"
        raise ConfigError(field, reference, f"{limits.lowest:g}..{limits.highest:g} {limits.unit}")
    if reading.sigma is not None and reading.sigma > STEADY * limits.tolerance:
        moves = f"{reading.sigma:.4f} {limits.unit}"
        raise NotNow(Message("cell-not-steady", cell=reading.cell % CELLS_PER_PACK + 1, moves=moves))
    error = reading.value - reference
    return CheckedCell(reading.cell, reading.value, reading.sigma, reference, error, abs(error) <= limit + 1e-9)


def _cause(cells: Sequence[CheckedCell], limit: float, quantity: QuantityName) -> tuple[Cause, float | None]:
    if not any(cell.is_good is False for cell in cells):
        return "none", None
    pairs = [(c.error, c.reference) for c in cells if c.error is not None and c.reference is not None]
    if quantity == "voltage" and len(pairs) > 2:
        # least squares of error = share * reference
        share = sum(e * r for e, r in pairs) / sum(r * r for _, r in pairs)
        if all(abs(e - share * r) <= limit for e, r in pairs):
            return "reference", share
    if quantity == "voltage" and _is_wire(cells):
        return "wire", None
    return "cells", None


def _is_wire(cells: Sequence[CheckedCell]) -> bool:
    """Two neighbours, one as much too high as the other is too low: the wire between them carries the difference."""
    bad = [cell for cell in cells if cell.is_good is False]
    if len(bad) != 2 or bad[1].cell - bad[0].cell != 1:
        return False
    first, second = bad[0].error or 0.0, bad[1].error or 0.0
    return first * second < 0 and 0.5 <= abs(first / second) <= 2.0


def _averaged(cell: int, values: list[float]) -> CellReading:
    if len(values) < SAMPLES:  # what is missing now and then is no measurement
        return CellReading(cell, None, None)
    mean = sum(values) / len(values)
    return CellReading(cell, mean, math.sqrt(sum((value - mean) ** 2 for value in values) / (len(values) - 1)))


def _sample(master: MasterClient, pack: int, quantity: QuantityName) -> list[float | None]:
    if quantity == "voltage":
        name = f"slave[{pack}].cvr"
        raws = read_field(master, name)
        return [None if raw in (0, CHIP_MISSING) else raw * FIELDS[name].scale for raw in raws]
    field, start = FIELDS["t"], FIELDS["t"].offset + pack * CELLS_PER_PACK
    signed = [raw - 256 if raw > 127 else raw for raw in master.read(start, CELLS_PER_PACK)]
    return [None if raw == T_MISSING else raw * field.scale for raw in signed]


def _require_rest(master: MasterClient, pack: int) -> None:
    if not 0 <= pack < N_PACKS:
        raise ConfigError("pack", pack, f"0..{N_PACKS - 1}")
    if read_field(master, f"slave[{pack}].status")[0] != _ACTIVE:
        raise NotNow(Message("slave-silent", pack=Pack(pack)))
    bits = read_field(master, f"slave[{pack}].cfgr")
    if bits[4] or bits[5] & 0x0F:
        raise NotNow(Message("pack-being-bled", pack=Pack(pack)))
    current_a = read_field(master, "i_fs")[0] * FIELDS["i_fs"].scale
    if abs(current_a) > REST_A:
        raise NotNow(Message("slave-at-rest", current=f"{current_a:.1f} A"))


@dataclass(frozen=True, slots=True)
class SlaveCheck:
    """One check; `number` counts from 1."""

    number: int
    t_wall_ns: int
    who: str
    pack: int  # 0..7
    quantity: QuantityName
    meter: str  # which one, in the words of whoever held it
    meter_error: float
    note: str
    verdict: SlaveVerdict


class SlaveCheckLog:
    """The file; thread-safe."""

    def __init__(self, folder: Path) -> None:
        self._file = JsonLines(folder / "slave-checks.jsonl")
        self._lock = threading.Lock()

    def append(
        self,
        t_wall_ns: int,
        who: str,
        pack: int,
        quantity: QuantityName,
        meter: str,
        meter_error: float,
        note: str,
        verdict: SlaveVerdict,
    ) -> SlaveCheck:
        """Keep a check; it is on the disk when this returns.

        Raises:
            OSError: it cannot be kept.
        """
        with self._lock:
            lines = self._file.lines()
            check = SlaveCheck(len(lines) + 1, t_wall_ns, who, pack, quantity, meter, meter_error, note, verdict)
            self._file.append(asdict(check), after=lines)
            return check

    def checks(self, pack: int | None = None, quantity: QuantityName | None = None) -> list[SlaveCheck]:
        """Return the checks, newest first; lines that are none are left out."""
        with self._lock:
            kept = [check for line in self._file.lines() if (check := _parse(line)) is not None]
        return [check for check in reversed(kept) if pack in (None, check.pack) and quantity in (None, check.quantity)]


def _parse(line: bytes) -> SlaveCheck | None:
    try:
        entry = parse_object(line)
        verdict = entry.pop("verdict")
        cells = tuple(CheckedCell(**cell) for cell in verdict.pop("cells"))
        verdict["out"] = tuple(verdict["out"])
        return checked(SlaveCheck(**entry, verdict=SlaveVerdict(cells, **verdict)))
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
