"""Visibility of an alarm's subject in a snapshot: what is not measured ends no alarm."""

from collections.abc import Callable

import numpy as np

from app.estimation.arrays import FloatArray
from app.live.alarm_rules import has_limits, has_trouble, is_recent
from app.telemetry import Alarm, Snapshot
from app.telemetry.measurement import BLANK_S
from app.words import Pack

_OF_LINKS = {f"{name}-{what}" for name in ("rs232", "can") for what in ("lost", "silent", "late")}
LINK_CODES = frozenset(_OF_LINKS | {"can-bus-off", "can-bus-passive"})


def is_judged(alarm: Alarm, snapshot: Snapshot) -> bool:
    """True where the snapshot knows what an alarm is about; where not, that it is not yielded says nothing."""
    code, total, master = alarm.code, snapshot.accumulator, snapshot.master
    if code.startswith(("cell-undervoltage", "cell-overvoltage")):
        return has_limits(snapshot) and _has_values(alarm, snapshot.cells.voltage_v, total.voltage_min_v)
    if code == "accumulator-voltage-high":
        return has_limits(snapshot) and total.voltage_v is not None
    if code == "pack-voltage-high":
        pack = alarm.message.args.get("pack")
        has_voltage = [pack.voltage_v is not None for pack in snapshot.packs]
        return has_limits(snapshot) and (has_voltage[pack.pack] if isinstance(pack, Pack) else all(has_voltage))
    if code in ("cell-overtemperature", "cell-overtemperature-near", "cell-undertemperature"):
        degc = snapshot.cells.temperature_degc
        return has_limits(snapshot) and _has_values(alarm, degc, total.temperature_max_degc)
    if code.endswith("-overcurrent"):
        return has_limits(snapshot) and total.current_a is not None
    if code in LINK_CODES:
        return _is_link_known(code, snapshot)
    if code.startswith(("charger", "charging")):
        return snapshot.charger.state is not None
    known_of: dict[str, Callable[[], bool]] = {
        "links-disagree": lambda: all(link.state == "live" for _, link in snapshot.links.items()),
        "master-fault": lambda: master.state != "unknown",
        "bms-fault": lambda: master.state != "unknown",
        "master-restarted": lambda: is_recent(snapshot),
        "map-mismatch": lambda: master.map_matches is not None,
        "cell-voltage-missing": lambda: _has_values(alarm, snapshot.cells.voltage_v, None),
        "value-implausible": lambda: is_recent(snapshot) and _are_recent(snapshot.age_s.current, snapshot.age_s.soc),
        "slave-lost": lambda: _are_slaves_known(alarm, snapshot),
        "slaves-too-few": lambda: master.n_slaves is not None,
        "model-not-valid": lambda: (
            snapshot.cells.model_valid is not None and _has_values(alarm, snapshot.cells.voltage_v, None)
        ),
    }
    return known_of.get(code, lambda: is_recent(snapshot))()


def _has_values(alarm: Alarm, values: FloatArray, reported: float | None) -> bool:
    """Every cell of an alarm has a value; where no cell has, as from a summary over CAN, what the master reports."""
    if np.isnan(values).all():
        return reported is not None
    cells = alarm.cells or (() if alarm.cell is None else (alarm.cell,))
    return bool(np.isfinite(values[list(cells)]).all())


def _is_link_known(code: str, snapshot: Snapshot) -> bool:
    """A port that is opened again, or has sent nothing yet, does not show that its trouble is over."""
    link = snapshot.links.rs232 if code.startswith("rs232") else snapshot.links.can
    if code.startswith("can-bus") and link.bus_state is not None:
        return True
    return link.state in ("off", "live") or (not code.startswith("can-bus") and has_trouble(link))


def _are_slaves_known(alarm: Alarm, snapshot: Snapshot) -> bool:
    """Every pack that it names has a voltage, and a status where the source reports any."""
    packs = alarm.message.args.get("packs")
    named = [snapshot.packs[pack.pack] for pack in packs if isinstance(pack, Pack)] if isinstance(packs, tuple) else []
    has_status = snapshot.age_s.slaves is not None
    is_known = all(pack.min_v is not None and (not has_status or pack.slave_status is not None) for pack in named)
    return is_recent(snapshot) and is_known


def _are_recent(*ages_s: float | None) -> bool:
    return all(age_s is None or age_s <= BLANK_S for age_s in ages_s)
