"""The master's EVENT frames in words."""

from app.telemetry import Event, Severity
from firmware_protocol.memory_map import CELLS_PER_PACK, CHARGER_STATES, N_CELLS
from firmware_protocol.messages import Event as MasterEvent
from firmware_protocol.messages import EventCode

_TRIPS: dict[int, tuple[str, float, str]] = {
    EventCode.TRIP_V_MIN: ("cell under-voltage", 1e-4, "V"),
    EventCode.TRIP_V_MAX: ("cell over-voltage", 1e-4, "V"),
    EventCode.TRIP_T_MIN: ("cell too cold", 1.0, "degC"),
    EventCode.TRIP_T_MAX: ("cell too hot", 1.0, "degC"),
    EventCode.TRIP_I_DISC: ("discharge over-current", 0.01, "A"),
    EventCode.TRIP_I_CHRG: ("charge over-current", 0.01, "A"),
    EventCode.TRIP_SLAVE_LOST: ("slave lost", 1.0, ""),
    EventCode.TRIP_SENSOR_LOST: ("sensor lost", 1.0, ""),
}
_BOOT_CAUSES = ("power on", "watchdog", "brown-out", "commanded")


def cell_name(cell: int) -> str:
    """The name people use: pack 3, cell 7."""
    return f"pack {cell // CELLS_PER_PACK + 1}, cell {cell % CELLS_PER_PACK + 1}"


def describe(message: MasterEvent, t_wall_ns: int) -> tuple[Event, str | None]:
    """Return the event for the log, and where it opened the shutdown circuit the reason in one line."""
    cell = message.cell if message.cell < N_CELLS else None
    if message.code in _TRIPS:
        text, scale, unit = _TRIPS[message.code]
        where = "" if cell is None else f", {cell_name(cell)}"
        value, limit = message.value * scale, message.limit * scale
        reason = f"{text}{where}: {value:g} {unit}, limit {limit:g} {unit}" if unit else f"{text}{where}"
        code = EventCode(message.code).name.lower().replace("_", "-")
        return Event(t_wall_ns, "trip", code, reason, cell, value, limit, unit), reason
    severity: Severity = "info"
    match message.code:
        case EventCode.BOOT:
            cause = _BOOT_CAUSES[message.value] if 0 <= message.value < len(_BOOT_CAUSES) else f"cause {message.value}"
            severity, text = "watch", f"master started: {cause}"
        case EventCode.FAULTS_CLEARED:
            text = "faults cleared"
        case EventCode.CHARGER_STATE:
            known = 0 <= message.value < len(CHARGER_STATES)
            text = f"charging: {CHARGER_STATES[message.value].replace('_', ' ') if known else message.value}"
        case EventCode.CONFIG_WRITTEN:
            text = "master took a new configuration"
        case EventCode.CONFIG_STORED:
            text = f"master stored its configuration (EEPROM counter {message.value})"
        case EventCode.CAN_RX_TIMEOUT:
            severity, text = "watch", f"CAN rx message {message.value} timed out"
        case EventCode.EEPROM_INVALID:
            severity, text = "warning", "EEPROM holds no valid configuration: the master runs on defaults"
        case EventCode.SOC_SET:
            text = f"master's state of charge set to {message.value / 100:g} %"
        case _:
            text = f"event {message.code}: value {message.value}, limit {message.limit}"
    code = EventCode(message.code).name.lower().replace("_", "-") if message.code in set(EventCode) else "master-event"
    return Event(t_wall_ns, severity, code, text, cell), None
