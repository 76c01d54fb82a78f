"""Sources of a battery: which signals of a DBC carry cells, current, pack voltage and state. No protocol code here."""

from dataclasses import dataclass, field
from typing import Literal

from app.battery.battery import SignalName
from app.battery.serial import SerialMapping, longest_age

MOST_PLACEHOLDERS = 6  # placeholders of a name pattern, stars among them: three parts and the text between them
LONGEST_PATTERN = 128  # characters, as many as a name of a DBC may have
PARTS = ("pack", "group", "cell")  # what numbers a cell: of names `{cell}`, or of signals in the frame
VOLTAGE_UNITS = {"V": 1.0, "mV": 1e-3, "0.1mV": 1e-4, "0.01V": 1e-2, "0.1V": 0.1}
CURRENT_UNITS = {"A": 1.0, "mA": 1e-3, "0.1A": 0.1, "0.01A": 0.01}
TEMPERATURE_UNITS = {"degC": 1.0, "0.1degC": 0.1, "0.01degC": 0.01, "K": 1.0, "0.1K": 0.1, "degF": 5 / 9}
RESISTANCE_UNITS = {"ohm": 1.0, "mohm": 1e-3, "0.01mohm": 1e-5}
ZERO_AT = {"K": -273.15, "0.1K": -273.15, "degF": -160 / 9}  # degC at 0 of the unit
SOC_UNITS = {"percent": 0.01, "fraction": 1.0, "0.1percent": 1e-3}
STATES = ("closed", "precharge", "fault", "charging", "balancing")
Kind = str  # a name of KINDS
READINGS = ("current", "pack_voltage", "soc", "charger_voltage", "charger_current")
KINDS: tuple[Kind, ...] = ("voltage", "temperature", "balancing", "resistance")


def part_of(name: str) -> str:
    """Return the part that a name stands for; older profiles name the pack `segment`."""
    return "pack" if name == "segment" else name


@dataclass(frozen=True, slots=True)
class CellSignals:
    """One way in which values of many cells are spoken.

    Index of a cell = first + start of its pack + (group - base) * group_cells + (cell - base); a part that is not
    seen counts as its base. Parts come from `{pack}`, `{group}`, `{cell}` in the names of signal and message, or
    from `numbers`, signals of the same frame.
    """

    signal: str  # pattern; `*` stands for anything
    message: str = "*"
    numbers: dict[str, str] = field(default_factory=dict, hash=False)  # part -> pattern of the signal that tells it
    base: dict[str, int] = field(default_factory=dict, hash=False)  # part -> lowest number; 0 where not named
    group_cells: int = 1
    first: int = 0  # cell, from 0, of which the lowest numbers tell
    order: tuple[int, ...] = ()  # the k-th value is that of this cell, from 0; empty: in order
    unit: str = ""  # unit of the decoded value; empty: the DBC's
    scale: float = 1.0
    offset: float = 0.0  # in V or degC, added after unit and scale
    invalid: tuple[int, ...] = ()  # raw numbers that mean: not measured
    invalid_signal: str = ""  # pattern of a signal that is not 0 where the value is invalid
    valid_signal: str = ""  # pattern of a signal that is 0 where the value is invalid
    valid_range: tuple[float, float] | None = None  # V or degC; beyond it a value is missing
    checksum: str = ""
    max_age_s: float | None = None  # older is missing; None: measured from what is received
    line: int | None = None  # line number in the profile


@dataclass(frozen=True, slots=True)
class ScalarSignal:
    """One quantity of the whole battery: value = sign * (decoded * unit - zero)."""

    signal: SignalName
    unit: str = ""
    positive: Literal["discharge", "charge"] = "discharge"  # sign of a current
    zero: float = 0.0
    max_age_s: float | None = None
    line: int | None = None


@dataclass(frozen=True, slots=True)
class StateSignal:
    """A claim about the battery: the signal's raw number is one of `equals`, or has one of the bits of `mask`."""

    signal: SignalName
    equals: tuple[int, ...] = (1,)
    mask: int = 0
    line: int | None = None


@dataclass(frozen=True, slots=True)
class DbcMapping:
    """A battery that is received by a DBC."""

    dbc: tuple[str, ...]  # files, as the profile names them
    cells: dict[Kind, tuple[CellSignals, ...]] = field(default_factory=dict, hash=False)
    current: ScalarSignal | None = None
    pack_voltage: ScalarSignal | None = None
    soc: ScalarSignal | None = None
    charger_voltage: ScalarSignal | None = None
    charger_current: ScalarSignal | None = None
    states: dict[str, StateSignal] = field(default_factory=dict, hash=False)  # by a name of STATES
    period_s: float = 0.1  # between two measurements that are made of what was received
    bit_rate: int | None = None  # bit rate of the bus [bit/s]

    @property
    def kinds(self) -> frozenset[str]:
        """Kinds of values that it sends, `state.…` among them."""
        readings = (name for name in READINGS if getattr(self, name) is not None)
        return frozenset((*self.cells, *readings, *(f"state.{name}" for name in self.states)))

    @property
    def ages(self) -> dict[str, float | None]:
        """Return the age from which values are missing, by kind [s]; None: as it is measured."""
        ages = {kind: longest_age(entry.max_age_s for entry in entries) for kind, entries in self.cells.items()}
        readings = {name: getattr(self, name) for name in READINGS}
        return ages | {name: reading.max_age_s for name, reading in readings.items() if reading is not None}


@dataclass(frozen=True, slots=True)
class MemoryMap:
    """The team's own master, by its memory map."""


@dataclass(frozen=True, slots=True)
class TableMapping:
    """Rows of a table that was imported: each tells every cell at one instant."""

    means_s: float = 0.0  # over which each current is a mean; 0: that of the instant, too


Source = DbcMapping | MemoryMap | TableMapping | SerialMapping
