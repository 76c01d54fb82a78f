"""The master's EVENT frames in words."""

from app.telemetry import Event, Flags, MasterState, Severity
from app.words import Cell, Message, Pack, Quantity
from firmware_protocol.memory_map import CELLS_PER_PACK, CHARGER_STATES, N_CELLS
from firmware_protocol.messages import EventCode, EventMessage

_TRIPS: dict[int, tuple[Message, float, str]] = {
    EventCode.TRIP_V_MIN: (Message("cell-undervoltage"), 1e-4, "V"),
    EventCode.TRIP_V_MAX: (Message("cell-overvoltage"), 1e-4, "V"),
    EventCode.TRIP_T_MIN: (Message("cell-undertemperature"), 1.0, "degC"),
    EventCode.TRIP_T_MAX: (Message("cell-overtemperature"), 1.0, "degC"),
    EventCode.TRIP_I_DISC: (Message("discharge-overcurrent"), 0.01, "A"),
    EventCode.TRIP_I_CHRG: (Message("charge-overcurrent"), 0.01, "A"),
    EventCode.TRIP_SLAVE_LOST: (Message("slave-lost"), 1.0, ""),
    EventCode.TRIP_SENSOR_LOST: (Message("sensor-lost"), 1.0, ""),
}
_CHARGER_STATES = {
    "off": Message("charger-off"),
    "waiting": Message("charger-waiting"),
    "constant_current": Message("charger-constant-current"),
    "constant_voltage": Message("charger-constant-voltage"),
    "balancing": Message("charger-balancing"),
    "done": Message("charger-done"),
    "fault": Message("charger-fault"),
}
_BOOT_CAUSES = (
    Message("boot-power-on"),
    Message("boot-watchdog"),
    Message("boot-brown-out"),
    Message("boot-commanded"),
)


def describe(message: EventMessage, t_wall_ns: int) -> tuple[Event, Message | None]:
    """Return the event for the log, and where it opened the shutdown circuit the reason."""
    cell = message.cell if message.cell < N_CELLS else None
    is_code = message.code in set(EventCode)
    code = EventCode(message.code).name.lower().replace("_", "-") if is_code else "master-event"
    if message.code in _TRIPS:
        what, scale, unit = _TRIPS[message.code]
        if message.code == EventCode.TRIP_SLAVE_LOST and cell is not None:  # the first of its pack
            reason = Message("slave-lost-in-packs", n=1, packs=(Pack(cell // CELLS_PER_PACK),))
            return Event(t_wall_ns, "trip", f"trip-{what.code}", reason), reason
        value, limit = message.value * scale, message.limit * scale
        reason = _reason(what, cell, Quantity(value, unit), Quantity(limit, unit))
        return Event(t_wall_ns, "trip", f"trip-{what.code}", reason, cell, value, limit, unit), reason
    severity: Severity = "info"
    match message.code:
        case EventCode.BOOT:
            severity, description = "watch", Message("master-started", cause=boot_cause(message))
        case EventCode.FAULTS_CLEARED:
            description = Message("faults-cleared")
        case EventCode.CHARGER_STATE:
            is_known = 0 <= message.value < len(CHARGER_STATES)
            description = Message("charging", state=charger_state(CHARGER_STATES[message.value] if is_known else None))
        case EventCode.CONFIG_WRITTEN:
            description = Message("master-took-config")
        case EventCode.CONFIG_STORED:
            description = Message("master-stored-config", counter=message.value)
        case EventCode.CAN_RX_TIMEOUT:
            severity, description = "watch", Message("can-rx-timeout", number=message.value)
        case EventCode.EEPROM_INVALID:
            severity, description = "warning", Message("eeprom-invalid")
        case EventCode.SOC_SET:
            description = Message("master-soc-set", soc=Quantity(message.value / 100, "%"))
        case _:
            description = Message("master-event", number=message.code, value=message.value, limit=message.limit)
    return Event(t_wall_ns, severity, code, description, cell), None


def boot_cause(message: EventMessage) -> Message:
    """Return why the master started, by its boot event."""
    is_known = 0 <= message.value < len(_BOOT_CAUSES)
    return _BOOT_CAUSES[message.value] if is_known else Message("boot-other", number=message.value)


def charger_state(state: str | None) -> Message:
    """The charger's state by the name that the firmware has for it, None where it is unknown."""
    return _CHARGER_STATES.get(state or "", Message("charger-state-unknown"))


def _reason(what: Message, cell: int | None, value: Quantity, limit: Quantity) -> Message:
    if cell is None:
        return Message("trip", what=what, value=value, limit=limit) if value.unit else what
    if value.unit:
        return Message("trip-cell", what=what, cell=Cell(cell), value=value, limit=limit)
    return Message("trip-at", what=what, cell=Cell(cell))


def state_of(flags: Flags | None, charging: str | None, last_trip: Message | None) -> tuple[MasterState, Message]:
    """Return what the car does, and why."""
    if flags is None:
        return "unknown", Message("no-status")
    if not flags.fit:
        return "fault", last_trip or Message("shutdown-circuit-open")
    if flags.charging:
        return "charge", Message("charger", state=charger_state(charging))
    if flags.balancing:
        return "balance", Message("cells-bled")
    if flags.load is None:
        return "unknown", Message("relays-unknown")
    if flags.load:
        return "drive", Message("relays-closed")
    return "idle", Message("charger-connected") if flags.charger else Message("relays-open")
