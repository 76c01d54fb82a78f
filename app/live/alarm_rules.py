"""Alarm rules, as facts about one snapshot: code, severity, where, value, limit. No memory, no time."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate

import numpy as np

from app.estimation.arrays import BoolArray
from app.estimation.health.cell_finding import FindingCode
from app.telemetry import AlarmSeverity, LinkStatus, ProtectionLimits, Snapshot
from app.telemetry.events import LATE, SILENT, link_lost
from app.telemetry.measurement import BLANK_S
from app.words import Cell, Message, Pack, Quantity, condition

NEAR_LOW_V = 0.2  # above the lowest voltage allowed
NEAR_HIGH_V = 0.01  # below the highest: a full cell stands close to it
T_WATCH_DEGC = 5.0
SUM_SLACK = 0.002  # relative slack of a limit of many cells' voltage
SLAVES_AWAY = (0, 255)  # absent, at fault
WIRE_CELLS = 2  # that an open sense wire leaves without a voltage; a pack without any has more
CHARGER_REPORTS = {
    "hardware": Message("charger-hardware-fault"),
    "over-temperature": Message("charger-over-temperature"),
    "input voltage": Message("charger-input-voltage"),
    "battery": Message("charger-no-battery"),
    "time-out": Message("charger-time-out"),
}


@dataclass(frozen=True, slots=True)
class AlarmCondition:
    """One thing that is wrong now."""

    severity: AlarmSeverity
    message: Message
    cell: int | None = None
    value: float | None = None
    limit: float | None = None
    unit: str = ""
    cells: tuple[int, ...] = ()  # every cell it is about, where they are more than `cell`
    of: str | None = None  # its code, where that is not the message's

    @property
    def code(self) -> str:
        """Equal for the same trouble."""
        return self.of or self.message.code


def conditions(snapshot: Snapshot, *, slack: float = 0.0) -> Iterator[AlarmCondition]:
    """Yield what is wrong in a snapshot.

    Args:
        snapshot: judged by itself.
        slack: 0 to raise; 1 to hold: limits moved inwards by a hysteresis (10 mV, 1 degC), so that an alarm ends only
            well inside its limit.
    """
    yield from _links(snapshot)
    if snapshot.limits is not None and has_limits(snapshot):
        yield from _limits(snapshot, snapshot.limits, slack)
    yield from _master(snapshot)
    yield from _cells(snapshot)


def has_limits(snapshot: Snapshot) -> bool:
    """Limits apply: in any state, or in one that is known."""
    limits = snapshot.limits
    return limits is not None and (limits.in_any_state or snapshot.master.state != "unknown")


def is_recent(snapshot: Snapshot) -> bool:
    """Voltages arrive, whatever they say."""
    age_s = snapshot.age_s.voltage
    return age_s is not None and age_s <= BLANK_S


def _links(snapshot: Snapshot) -> Iterator[AlarmCondition]:
    for name, status in snapshot.links.items():
        if not has_trouble(status):
            continue
        if status.state == "lost":
            yield AlarmCondition("warning", link_lost(name, status.error))
        elif status.state == "silent":
            yield AlarmCondition("warning", SILENT[name], value=status.age_s, limit=1.0, unit="s")
        else:
            yield AlarmCondition("warning", LATE[name], value=status.age_s, limit=1.0, unit="s")

    can = snapshot.links.can
    if can.bus_state in ("passive", "off"):
        yield AlarmCondition(
            "warning",
            Message("can-bus-off") if can.bus_state == "off" else Message("can-bus-passive"),
            value=None if can.errors is None else float(can.errors),
            unit="errors",
        )
    if snapshot.disagreements:
        first = snapshot.disagreements[0]
        by_rs232 = Quantity(first.rs232, first.unit)
        disagree = Message("links-disagree", name=first.name, n=len(snapshot.disagreements), by_rs232=by_rs232)
        yield AlarmCondition("warning", disagree, value=first.can, unit=first.unit)


def has_trouble(link: LinkStatus) -> bool:
    """It is lost, late, or silent after it had sent."""
    return link.state in ("lost", "late") or (link.state == "silent" and link.frames > 0)


def _limits(snapshot: Snapshot, limits: ProtectionLimits, slack: float) -> Iterator[AlarmCondition]:
    total = snapshot.accumulator
    volts, degrees = 0.01 * slack, 1.0 * slack
    low, high = limits.cell_voltage_min_v, limits.cell_voltage_max_v
    value, cell = total.voltage_min_v, total.voltage_min_cell
    if value is not None:
        if value < low + volts:
            yield AlarmCondition("trip", Message("cell-undervoltage"), cell, value, low, "V")
        elif value < low + NEAR_LOW_V + volts:
            yield AlarmCondition("watch", Message("cell-undervoltage-near"), cell, value, low, "V")
    value, cell = total.voltage_max_v, total.voltage_max_cell
    if value is not None:
        if value > high - volts:
            yield AlarmCondition("trip", Message("cell-overvoltage"), cell, value, high, "V")
        elif value > high - NEAR_HIGH_V - volts:
            yield AlarmCondition("watch", Message("cell-overvoltage-near"), cell, value, high, "V")
    yield from _sums(snapshot, limits, slack)
    cold, hot = limits.temperature_min_degc, limits.temperature_max_degc
    value, cell = total.temperature_max_degc, total.temperature_max_cell
    if value is not None:
        if value > hot - degrees:
            yield AlarmCondition("trip", Message("cell-overtemperature"), cell, value, hot, "degC")
        elif value > hot - T_WATCH_DEGC - degrees:
            yield AlarmCondition("watch", Message("cell-overtemperature-near"), cell, value, hot, "degC")
    value, cell = total.temperature_min_degc, total.temperature_min_cell
    if value is not None and value < cold + degrees:
        yield AlarmCondition("trip", Message("cell-undertemperature"), cell, value, cold, "degC")
    current_a = total.current_a
    charging = snapshot.master.state == "charge"
    top_a = -limits.charger_min_a if charging else limits.discharge_max_a
    bottom_a = -limits.charger_max_a * 1.05 if charging else limits.discharge_min_a
    if current_a is not None and not charging and current_a > top_a:
        yield AlarmCondition("trip", Message("discharge-overcurrent"), None, current_a, top_a, "A")
    if current_a is not None and current_a < bottom_a - 1.0:
        yield AlarmCondition("trip", Message("charge-overcurrent"), None, current_a, bottom_a, "A")


def _sums(snapshot: Snapshot, limits: ProtectionLimits, slack: float) -> Iterator[AlarmCondition]:
    """Voltages of all cells and of each pack."""
    kept = 1.0 - SUM_SLACK * slack
    total, high = snapshot.accumulator, limits.accumulator_voltage_max_v
    value = total.voltage_at_least_v if total.voltage_v is None else total.voltage_v
    if value is not None and value > high * kept:
        yield AlarmCondition("trip", Message("accumulator-voltage-high"), None, value, high, "V")
    high = limits.pack_voltage_max_v
    sums = [(pack.voltage_v, index) for index, pack in enumerate(snapshot.packs) if pack.voltage_v is not None]
    value, index = max(sums, default=(0.0, 0))
    if value > high * kept:
        yield AlarmCondition("trip", Message("pack-voltage-high", pack=Pack(index)), None, value, high, "V")


def _master(snapshot: Snapshot) -> Iterator[AlarmCondition]:
    master = snapshot.master
    if master.state == "fault" and master.why.code == "bms-state":
        yield AlarmCondition("trip", Message("bms-fault"))
    elif master.state == "fault":
        yield _fault(master.why, snapshot.segments)
    if master.restarted is not None:
        yield AlarmCondition("warning", Message("master-restarted", cause=master.restarted))
    if master.map_matches is False:
        yield AlarmCondition("warning", Message("map-mismatch"))
    if master.implausible:
        yield AlarmCondition("warning", Message("value-implausible", fields=master.implausible))
    missing = tuple(Pack(index) for index in lost_packs(snapshot))
    if missing:
        message = Message("slave-lost-in-packs", n=len(missing), packs=missing)
        yield AlarmCondition("warning", message, of="slave-lost")
    elif master.n_slaves is not None and master.n_slaves < len(snapshot.packs):
        yield AlarmCondition("warning", Message("slaves-too-few", n=master.n_slaves, expected=len(snapshot.packs)))
    if snapshot.charger.state == "fault":
        yield AlarmCondition("warning", Message("charging-fault"))
    for flag in snapshot.charger.flags:
        yield AlarmCondition("warning", CHARGER_REPORTS[flag])


def _fault(why: Message, segments: tuple[int, ...]) -> AlarmCondition:
    """The master's trip, with the cell, the value and the limit that its reason names."""
    what, cell, value, limit, packs = (why.args.get(name) for name in ("what", "cell", "value", "limit", "packs"))
    return AlarmCondition(
        "trip",
        Message("master-fault", why=what if isinstance(what, Message) else why),
        cell.index if isinstance(cell, Cell) else None,
        value.value if isinstance(value, Quantity) else None,
        limit.value if isinstance(limit, Quantity) else None,
        value.unit if isinstance(value, Quantity) else "",
        tuple(cell for pack in packs if isinstance(pack, Pack) for cell in _cells_of(pack.pack, segments))
        if isinstance(packs, tuple)
        else (),
    )


def is_reason_lost(condition: AlarmCondition) -> bool:
    """The circuit is open, and the master's reason came before the service listened: what is known of it stays."""
    why = condition.message.args.get("why")
    return condition.code == "master-fault" and isinstance(why, Message) and why.code == "shutdown-circuit-open"


def _cells_of(pack: int, segments: tuple[int, ...]) -> range:
    """The cells of a pack."""
    end = sum(segments[: pack + 1])
    return range(end - segments[pack], end) if pack < len(segments) else range(0)


def lost_packs(snapshot: Snapshot) -> list[int]:
    """Packs whose slave board is lost: by its status, or because no cell has a voltage while other packs have."""
    segments, packs = snapshot.segments, snapshot.packs
    has_any = any(pack.min_v is not None for pack in packs)
    firsts = accumulate(segments, initial=0)
    lost = []
    for index, (pack, n_cells, first) in enumerate(zip(packs, segments, firsts, strict=False)):
        is_awaited = snapshot.awaited is not None and bool(snapshot.awaited[first : first + n_cells].any())
        is_blank = has_any and pack.min_v is None and n_cells > WIRE_CELLS and not is_awaited
        if pack.slave_status in SLAVES_AWAY or is_blank:
            lost.append(index)
    return lost


def _cells(snapshot: Snapshot) -> Iterator[AlarmCondition]:
    voltage_v = snapshot.cells.voltage_v
    is_missing = np.isnan(voltage_v)
    for pack in lost_packs(snapshot):
        if snapshot.packs[pack].min_v is None:  # that the slave is lost is an alarm of its own
            is_missing[list(_cells_of(pack, snapshot.segments))] = False
    missing = _indices(is_missing if snapshot.awaited is None else is_missing & ~snapshot.awaited)
    if missing and (len(missing) < len(voltage_v) or is_recent(snapshot)):
        yield AlarmCondition("warning", Message("cell-voltage-missing", n=len(missing)), missing[0], cells=missing)
    yield from _findings(snapshot)
    if snapshot.cells.model_valid is not None:
        invalid = _indices(~snapshot.cells.model_valid & ~np.isnan(voltage_v))
        if invalid:
            yield AlarmCondition("watch", Message("model-not-valid", n=len(invalid)), invalid[0], cells=invalid)


def _indices(is_so: BoolArray) -> tuple[int, ...]:
    return tuple(np.flatnonzero(is_so).tolist())


def _findings(snapshot: Snapshot) -> Iterator[AlarmCondition]:
    """Every kind of finding once, with all its cells; a missing voltage has an alarm of its own."""
    for code in _FINDINGS:
        findings = [finding for finding in snapshot.findings if finding.code == code]
        if findings:
            worst = max(findings, key=lambda finding: finding.size or 0.0)
            cells = (worst.cell, *(finding.cell for finding in findings if finding is not worst))
            value, unit = worst.size, worst.unit
            if value is not None and unit == "ohm":
                value, unit = 1000 * value, "mohm"
            yield AlarmCondition("warning", condition(code, len(findings)), worst.cell, value, None, unit, cells)


_FINDINGS: tuple[FindingCode, ...] = (
    "joint-resistance-high",
    "cell-resistance-high",
    "capacity-low",
    "self-discharge-high",
    "temperature-sensor-fault",
    "temperature-sensor-open",
    "cell-voltage-stuck",
)
