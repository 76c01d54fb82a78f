"""Expectations of a replayed session: alarms and estimates, out of a TOML file.

`Expectations` is fed the replay in order and says at the end which of them held. No clock, no file.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from math import inf, isfinite, sqrt
from typing import Any, Final

from app.battery.battery import Battery
from app.errors import ConfigError
from app.estimation.toml_text import TomlError, read_toml
from app.telemetry import Accumulator, Cells
from app.telemetry.fields import LEFT_OUT, marked, units
from app.words import condition_of

TOTALS: Final = tuple(name for name, _ in units(Accumulator))
PER_CELL: Final = tuple(name for name, _ in units(Cells) if name not in marked(Cells, LEFT_OUT))
SEVERITIES: Final = ("watch", "warning", "trip")
_NAME = re.compile(r"(?P<name>[a-z_]+)(?:\[(?P<pack>\d{1,4})/(?P<cell>\d{1,4})\])?")
_PLACE = re.compile(r"(?P<pack>\d{1,4})/(?P<cell>\d{1,4})")
_SECTIONS: Final = ("replay", "alarm", "no_alarm", "value", "agreement")


@dataclass(frozen=True)
class Raised:
    """An alarm or a trip that the replay raised."""

    t_s: float
    code: str
    severity: str
    cell: int | None


@dataclass(frozen=True)
class SnapshotValues:
    """Values of one snapshot of the replay, and the charge recorded then."""

    t_s: float
    totals: Accumulator
    cells: Cells
    recorded_soc: float | None


@dataclass(frozen=True)
class ExpectationResult:
    """One expectation, and whether it held."""

    held: bool
    text: str
    found: str


@dataclass
class _Alarm:
    text: str
    code: str | None
    severity: str | None
    cell: int | None
    from_s: float
    to_s: float
    count: int | None  # None: at least once
    raised: list[Raised] = field(default_factory=list)

    def take(self, raised: Raised) -> None:
        if (
            self.code in (None, raised.code)
            and self.severity in (None, raised.severity)
            and (self.cell is None or self.cell == raised.cell)
            and self.from_s <= raised.t_s <= self.to_s
        ):
            self.raised.append(raised)

    def verdict(self, battery: Battery) -> ExpectationResult:
        n = len(self.raised)
        held = n > 0 if self.count is None else n == self.count
        seen = ", ".join(
            f"{raised.code}{_where(raised.cell, battery)} at {raised.t_s:.2f} s" for raised in self.raised[:5]
        )
        return ExpectationResult(
            held, self.text, seen + (f" and {n - 5} more" if n > 5 else "") if n else "never raised"
        )


@dataclass
class _Value:
    text: str
    name: str
    cell: int | None
    from_s: float
    to_s: float
    at_s: float | None
    minimum: float
    maximum: float
    low: float = inf
    high: float = -inf
    samples: int = 0

    def take(self, values: SnapshotValues) -> None:
        if not self.from_s <= values.t_s <= self.to_s:
            return
        value = getattr(values.totals, self.name) if self.cell is None else getattr(values.cells, self.name)[self.cell]
        if value is None or not isfinite(value):
            return
        if self.at_s is not None and self.samples:
            return  # the first one at or after the time
        self.samples += 1
        self.low, self.high = min(self.low, float(value)), max(self.high, float(value))

    def verdict(self) -> ExpectationResult:
        if not self.samples:
            return ExpectationResult(False, self.text, "never known")
        held = self.minimum <= self.low and self.high <= self.maximum
        text = f"{self.low:.6g}" if self.low == self.high else f"{self.low:.6g} to {self.high:.6g}"
        return ExpectationResult(held, self.text, text)


@dataclass
class _Agreement:
    text: str
    rms_max: float
    largest_max: float
    from_s: float
    to_s: float
    square: float = 0.0
    largest: float = 0.0
    samples: int = 0

    def take(self, values: SnapshotValues) -> None:
        now, was = values.totals.soc, values.recorded_soc
        if now is None or was is None or not self.from_s <= values.t_s <= self.to_s:
            return
        self.samples += 1
        self.square += (now - was) ** 2
        self.largest = max(self.largest, abs(now - was))

    def verdict(self) -> ExpectationResult:
        if not self.samples:
            return ExpectationResult(False, self.text, "nothing to compare: the session holds no estimates there")
        rms = sqrt(self.square / self.samples)
        held = rms <= self.rms_max and self.largest <= self.largest_max
        return ExpectationResult(held, self.text, f"RMS {rms:.5f}, largest {self.largest:.5f}")


class Expectations:
    """The expectations of a file; `alarm` and `values` are given the replay, `verdicts` returns which held."""

    def __init__(self, text: str, battery: Battery) -> None:
        """Read the text of the file, which names cells of the battery as pack/cell.

        Raises:
            ConfigError: it is no TOML, or expects something that cannot be; names the entry.
        """
        self._battery = battery
        try:
            document = read_toml(text)
        except TomlError as error:
            raise ConfigError("expectations", "(file)", f"TOML: {error}") from error
        _refuse_unknown("expectations", document, _SECTIONS)
        replay = document.get("replay", {})
        _refuse_unknown("replay", replay, ("filter", "cell"))
        self.filter_name: str | None = replay.get("filter")
        self.cell_name: str | None = replay.get("cell")
        self._alarms = [
            _alarm(entry, section, number, battery)
            for section in ("alarm", "no_alarm")
            for number, entry in enumerate(_entries(document, section), 1)
        ]
        self._values = [_value(entry, number, battery) for number, entry in enumerate(_entries(document, "value"), 1)]
        self._agreements = [
            _agreement(entry, number) for number, entry in enumerate(_entries(document, "agreement"), 1)
        ]
        if not (self._alarms or self._values or self._agreements):
            raise ConfigError("expectations", "(none)", "at least one alarm, no_alarm, value or agreement")

    def alarm(self, raised: Raised) -> None:
        """Take something that was raised; what ended is not given."""
        for alarm in self._alarms:
            alarm.take(raised)

    def values(self, values: SnapshotValues) -> None:
        """Take a snapshot."""
        for value in self._values:
            value.take(values)
        for agreement in self._agreements:
            agreement.take(values)

    def verdicts(self) -> list[ExpectationResult]:
        """Return what held and what did not, in the file's order within each kind."""
        results = [alarm.verdict(self._battery) for alarm in self._alarms] + [value.verdict() for value in self._values]
        return results + [agreement.verdict() for agreement in self._agreements]


def _alarm(entry: dict[str, Any], section: str, number: int, battery: Battery) -> _Alarm:
    where = f"{section}[{number}]"
    keys = ("code", "severity", "cell", "from_s", "to_s") + (("count",) if section == "alarm" else ())
    _refuse_unknown(where, entry, keys)
    code, severity = condition_of(entry.get("code") or "") or None, entry.get("severity")
    if code is None and severity is None:
        raise ConfigError(where, "(neither)", "code or severity")
    if severity is not None and severity not in SEVERITIES:
        raise ConfigError(f"{where}.severity", severity, f"one of {', '.join(SEVERITIES)}")
    count = 0 if section == "no_alarm" else entry.get("count")
    if count is not None and (not isinstance(count, int) or count < 0):
        raise ConfigError(f"{where}.count", count, "a whole number from 0")
    from_s, to_s = _span(where, entry)
    cell = _place(where, entry["cell"], battery) if "cell" in entry else None
    what = " ".join(str(part) for part in (severity, code) if part) + _where(cell, battery) + _when(from_s, to_s)
    times = "" if count in (None, 0) else ", exactly once" if count == 1 else f", exactly {count} times"
    return _Alarm(f"{'no ' if count == 0 else ''}alarm {what}{times}", code, severity, cell, from_s, to_s, count)


def _value(entry: dict[str, Any], number: int, battery: Battery) -> _Value:
    where = f"value[{number}]"
    _refuse_unknown(where, entry, ("name", "min", "max", "at_s", "from_s", "to_s"))
    match = _NAME.fullmatch(str(entry.get("name", "")))
    per_cell = match is not None and match["pack"] is not None
    if match is None or match["name"] not in (PER_CELL if per_cell else TOTALS):
        limit = f"one of {', '.join(TOTALS)}; or with [pack/cell] one of {', '.join(PER_CELL)}"
        raise ConfigError(f"{where}.name", entry.get("name"), limit)
    if "min" not in entry and "max" not in entry:
        raise ConfigError(where, "(neither)", "min or max")
    cell = _place(where, f"{match['pack']}/{match['cell']}", battery) if per_cell else None
    low, high = _number(where, entry, "min", -inf), _number(where, entry, "max", inf)
    from_s, to_s = _span(where, entry)
    at_s = _number(where, entry, "at_s", inf) if "at_s" in entry else None
    if at_s is not None:
        from_s = at_s
    bounds = " and ".join(
        part for part in (f"at least {low:g}" * (low > -inf), f"at most {high:g}" * (high < inf)) if part
    )
    when = f" at {at_s:g} s" if at_s is not None else _when(from_s, to_s)
    return _Value(f"{entry['name']} {bounds}{when}", match["name"], cell, from_s, to_s, at_s, low, high)


def _agreement(entry: dict[str, Any], number: int) -> _Agreement:
    where = f"agreement[{number}]"
    _refuse_unknown(where, entry, ("rms_max", "largest_max", "from_s", "to_s"))
    if "rms_max" not in entry and "largest_max" not in entry:
        raise ConfigError(where, "(neither)", "rms_max or largest_max")
    rms, largest = _number(where, entry, "rms_max", inf), _number(where, entry, "largest_max", inf)
    from_s, to_s = _span(where, entry)
    parts = (f"RMS at most {rms:g}" * (rms < inf), f"never more than {largest:g}" * (largest < inf))
    text = f"charge as recorded: {', '.join(part for part in parts if part)}{_when(from_s, to_s)}"
    return _Agreement(text, rms, largest, from_s, to_s)


def _entries(document: dict[str, Any], section: str) -> list[dict[str, Any]]:
    entries = document.get(section, [])
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise ConfigError(section, entries, f"entries that begin with [[{section}]]")
    return entries


def _refuse_unknown(where: str, entry: object, keys: tuple[str, ...]) -> None:
    if not isinstance(entry, dict):
        raise ConfigError(where, entry, "a table")
    for name in entry:
        if name not in keys:
            raise ConfigError(f"{where}.{name}", entry[name], f"known here: {', '.join(keys)}")


def _number(where: str, entry: dict[str, Any], name: str, default: float) -> float:
    value = entry.get(name, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or value != value:
        raise ConfigError(f"{where}.{name}", value, "a number")
    return float(value)


def _span(where: str, entry: dict[str, Any]) -> tuple[float, float]:
    from_s, to_s = _number(where, entry, "from_s", -inf), _number(where, entry, "to_s", inf)
    if to_s < from_s:
        raise ConfigError(f"{where}.to_s", to_s, f"not before from_s = {from_s:g}")
    return from_s, to_s


def _place(where: str, text: object, battery: Battery) -> int:
    match = _PLACE.fullmatch(str(text))
    pack, cell = (int(match["pack"]), int(match["cell"])) if match else (0, 0)
    index = battery.cell_at(pack - 1, cell - 1)
    if index is None:
        raise ConfigError(f"{where}.cell", text, f"pack/cell, 1/1 to {battery.n_packs}/{battery.segments[-1]}")
    return index


def _where(cell: int | None, battery: Battery) -> str:
    if cell is None:
        return ""
    pack, place = battery.place(cell)
    return f" of {pack + 1}/{place + 1}"


def _when(from_s: float, to_s: float) -> str:
    if from_s > -inf and to_s < inf:
        return f" from {from_s:g} to {to_s:g} s"
    return f" from {from_s:g} s" if from_s > -inf else f" until {to_s:g} s" if to_s < inf else ""
