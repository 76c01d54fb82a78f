"""The worked examples of SPEC.md: one frame of every message, command and event, as the codec makes it."""

from collections.abc import Iterator

from firmware_protocol.config_image import default_image
from firmware_protocol.framing import encode_frame
from firmware_protocol.memory_map import FIELDS, MAP_HASH
from firmware_protocol.messages import (
    EEPROM_READ_BASE,
    NO_OFFSET,
    Command,
    CommandId,
    Data,
    EventCode,
    EventMessage,
    FromMaster,
    Ident,
    IdentRequest,
    Load,
    MessageType,
    Read,
    Reply,
    Request,
    Result,
    Store,
    Window,
    Write,
    encode_request,
)

_TYPES: dict[type, MessageType] = {
    Data: MessageType.DATA,
    Reply: MessageType.REPLY,
    EventMessage: MessageType.EVENT,
}
_ARGUMENTS = {  # of the commands that take one
    CommandId.FAN_OVERRIDE: 128 + 256 * 60,
    CommandId.SET_SOC: 9991,
    CommandId.CAN_TX_ENABLE: 0b110,
    CommandId.CAN_SEND: 2,
    CommandId.BALANCE_CELLS: 2 * 4096 + 0b1000_0000_0001,
}
_EVENTS: dict[EventCode, tuple[int, int, int]] = {  # cell, value, limit
    EventCode.BOOT: (NO_OFFSET, 1, 0),
    EventCode.TRIP_V_MIN: (95, 24_987, 25_000),
    EventCode.TRIP_V_MAX: (36, 42_013, 42_000),
    EventCode.TRIP_T_MIN: (0, -16, -15),
    EventCode.TRIP_T_MAX: (54, 46, 45),
    EventCode.TRIP_I_DISC: (NO_OFFSET, 20_150, 20_000),
    EventCode.TRIP_I_CHRG: (NO_OFFSET, 1_310, 1_200),
    EventCode.TRIP_SLAVE_LOST: (24, 0, 0),
    EventCode.TRIP_SENSOR_LOST: (NO_OFFSET, 0, 0),
    EventCode.FAULTS_CLEARED: (NO_OFFSET, 0, 0),
    EventCode.CHARGER_STATE: (NO_OFFSET, 2, 0),
    EventCode.CONFIG_WRITTEN: (NO_OFFSET, 4, 2),
    EventCode.CONFIG_STORED: (NO_OFFSET, 7, 0),
    EventCode.CAN_RX_TIMEOUT: (NO_OFFSET, 0, 5_000),
    EventCode.EEPROM_INVALID: (NO_OFFSET, 0, 0),
    EventCode.SOC_SET: (NO_OFFSET, 9_991, 0),
}


def _field(name: str, count: int) -> Window:
    field = FIELDS[name]
    return Window(field.offset, count.to_bytes(field.item_size, "little", signed=field.fmt.islower()))


def _exchanges() -> Iterator[tuple[str, Request | FromMaster]]:
    yield "who are you", IdentRequest()
    yield "1.2.3, power on, start 41", Reply(16, 0, 0, data=Ident((1, 2, 3), MAP_HASH, 1, 0, 41).to_bytes())
    yield "`ts`", Read(0, 2)
    yield "100 ms; no offset", Reply(17, 2, 0, data=(100).to_bytes(2, "little"))
    yield "the first 16 bytes of the EEPROM", Read(EEPROM_READ_BASE, 16)
    yield "a store is under way", Reply(17, 4, Result.NOT_NOW)
    yield "`v_cell_max` 4.15 V", Write(4, (41_500).to_bytes(2, "little"))
    yield "done", Reply(18, 6, 0)
    yield "`v_cell_max` 4.51 V", Write(4, (45_100).to_bytes(2, "little"))
    yield "above its range, at offset 4", Reply(18, 8, Result.OUT_OF_RANGE, 4)
    yield "STORE", Store()
    yield "the EEPROM does not answer", Reply(19, 10, Result.EEPROM_FAILED)
    yield "LOAD", Load()
    yield "no slot is valid", Reply(20, 12, Result.NOTHING_STORED)


def _data() -> Iterator[tuple[str, Data]]:
    yield "`i_fs` -0.05 A", Data((_field("i_fs", -5),))
    yield "`soc` 99.91 %, `n_slaves` 8: two windows", Data((_field("soc", 9991), _field("n_slaves", 8)))
    yield "`status` and `charger` at rest: fit, usart1, can1", Data((Window(420, _status_and_charger()),))
    yield "no window", Data(())
    yield "a window of length 0 at 420, and `n_slaves` 8", Data((Window(420, b""), _field("n_slaves", 8)))


def _status_and_charger() -> bytes:
    masks = default_image()[39], default_image()[224]
    return (0b11001).to_bytes(4, "little") + bytes((*masks, 0, 255)) + bytes(8) + bytes((1, 0, 0, 32))


def rows() -> Iterator[tuple[str, str, int, int, bytes, bytes]]:
    """Yield (what it says, message, sequence, uptime_ms, body, bytes on the line) of each example."""
    messages: list[tuple[str, Request | FromMaster]] = [*_exchanges()]
    messages += [(command.name, Command(command, _ARGUMENTS.get(command, 0))) for command in CommandId]
    messages += _data()
    messages += [(code.name, EventMessage(code, 0, *event)) for code, event in _EVENTS.items()]
    for n, (what, message) in enumerate(messages):
        if isinstance(message, Data | Reply | EventMessage):
            kind, body, uptime_ms = _TYPES[type(message)], message.to_body(), 90_000 + 20 * n
        else:
            kind, body = encode_request(message)
            uptime_ms = 0
        yield what, kind.name, n, uptime_ms, body, encode_frame(kind, n, uptime_ms, body)
