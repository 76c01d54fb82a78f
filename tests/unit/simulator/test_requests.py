import pytest

from firmware_protocol.config_image import default_image, with_value
from firmware_protocol.eeprom import StoredConfig, encode_slot, newest, plan_store
from firmware_protocol.framing import encode_frame
from firmware_protocol.memory_map import CONFIG, CONFIG_SIZE, MAP_HASH, MASTER_SIZE
from firmware_protocol.messages import (
    EEPROM_READ_BASE,
    NO_OFFSET,
    Command,
    CommandId,
    EventCode,
    Ident,
    IdentRequest,
    Load,
    MessageType,
    Read,
    Result,
    Store,
    Write,
)
from simulator.bms_state import RelayState
from simulator.eeprom import Eeprom
from simulator.loads import ConstantCurrent
from simulator.simulation import SLOW_PERIOD_S


def config_of(host) -> bytes:
    return host.ask(Read(0, CONFIG_SIZE)).data


def test_ident_names_this_map(host):
    ident = Ident.from_bytes(host.ask(IdentRequest()).data)
    assert ident.map_hash == MAP_HASH
    assert ident.is_compatible
    assert (ident.reset_cause, ident.boots) == (0, 1)


def test_read_gives_the_bytes_of_the_struct(host):
    assert config_of(host) == default_image()
    assert host.ask(Read(MASTER_SIZE - 2, 2)).data == bytes(host.simulation.master.image[-2:])


@pytest.mark.parametrize(
    ("offset", "length", "result"),
    [
        (MASTER_SIZE - 1, 2, Result.OUT_OF_BOUNDS),
        (EEPROM_READ_BASE - 1, 1, Result.OUT_OF_BOUNDS),
        (0xFFFF, 2, Result.OUT_OF_BOUNDS),
    ],
)
def test_read_beyond_the_memories_is_refused(host, offset, length, result):
    reply = host.ask(Read(offset, length))
    assert (reply.result, reply.offset, reply.data) == (result, offset, b"")


def test_written_configuration_is_in_force_and_told(host):
    wanted = host.config(v_cell_max=4.15, ts=50)
    assert host.ask(Write(0, wanted)).result == Result.DONE
    assert config_of(host) == wanted
    assert CONFIG["ts"].unpack(host.simulation.master.image)[0] == 50
    assert host.events[-1].code == EventCode.CONFIG_WRITTEN


@pytest.mark.parametrize(
    ("ts", "result"), [(0, Result.OUT_OF_RANGE), (1, Result.DONE), (200, Result.DONE), (201, Result.OUT_OF_RANGE)]
)
def test_the_buffer_takes_so_many_samples(host, ts, result):
    reply = host.ask(Write(0, ts.to_bytes(2, "little")))
    assert (reply.result, reply.offset) == (result, NO_OFFSET if result == Result.DONE else 0)


def test_an_image_of_the_first_map_is_refused(host):
    first = (100).to_bytes(2, "little") + default_image()[2:226] + bytes(2) + default_image()[228:]
    reply = host.ask(Write(0, first))
    assert (reply.result, reply.offset) == (Result.OUT_OF_RANGE, CONFIG["telemetry_period"].offset)


def test_a_value_out_of_range_is_refused_whole_with_its_offset(host):
    bad = bytearray(host.config(ts=50))
    bad[CONFIG["v_cell_max"].offset : CONFIG["v_cell_max"].end] = (60_000).to_bytes(2, "little")
    reply = host.ask(Write(0, bytes(bad)))
    assert (reply.result, reply.offset) == (Result.OUT_OF_RANGE, CONFIG["v_cell_max"].offset)
    assert config_of(host) == default_image()


def test_a_partial_write_is_judged_by_the_whole_it_would_make(host):
    above_v_cell_max = (42_500).to_bytes(2, "little")  # within the field's own range
    assert host.ask(Write(CONFIG["v_cell_chrg"].offset, above_v_cell_max)).result == Result.OUT_OF_RANGE
    assert config_of(host) == default_image()


@pytest.mark.parametrize(
    ("message_type", "body", "result"),
    [
        (MessageType.WRITE, b"\xa3\x01\x02\x00ab", Result.OUT_OF_BOUNDS),
        (MessageType.WRITE, b"\x00\x00\x00\x00", Result.BAD_LENGTH),
        (MessageType.WRITE, b"\x00\x00\x05\x00ab", Result.BAD_LENGTH),
        (MessageType.READ, b"\x00", Result.BAD_LENGTH),
        (MessageType.READ, b"\x00\x00\x00\x00", Result.BAD_LENGTH),
        (MessageType.IDENT, b"x", Result.BAD_LENGTH),
        (0x55, b"", Result.UNKNOWN_REQUEST),
        (MessageType.DATA, b"", Result.UNKNOWN_REQUEST),
        (MessageType.COMMAND, b"\xc8\0\0\0\0", Result.UNKNOWN_REQUEST),
    ],
)
def test_malformed_requests_are_refused_by_name(host, message_type, body, result):
    before = bytes(host.simulation.master.image[:CONFIG_SIZE])
    host.simulation.receive(encode_frame(message_type, 77, 0, body))
    host.run(0.1)
    assert (host.replies[-1].request_sequence, host.replies[-1].result) == (77, result)
    assert bytes(host.simulation.master.image[:CONFIG_SIZE]) == before


def test_stored_configuration_survives_a_reset_and_can_be_loaded_back(host):
    stored = host.config(v_cell_chrg=4.1)
    host.ask(Write(0, stored))
    assert host.ask(Store()).result == Result.DONE
    host.run(0.1)
    assert host.events[-1].code == EventCode.CONFIG_STORED
    host.ask(Write(0, default_image()))
    assert host.ask(Load()).result == Result.DONE
    assert config_of(host) == stored
    host.ask(Write(0, default_image()))
    assert host.ask(Command(CommandId.RESET)).result == Result.DONE
    host.run(2.0)
    assert config_of(host) == stored
    assert [event.value for event in host.events if event.code == EventCode.BOOT] == [0, 3]


def test_padding_is_kept_at_zero(host):
    wanted = bytearray(host.config(ts=50))
    wanted[225] = 0xAB
    assert host.ask(Write(0, bytes(wanted))).result == Result.DONE
    assert config_of(host) == host.config(ts=50)


def test_a_stored_configuration_that_a_write_would_refuse_is_not_loaded(host):
    eeprom = host.simulation.board.eeprom
    for page in plan_store(bytes(eeprom.content), bytes(CONFIG_SIZE)):
        eeprom.write(page.offset, page.data)
    assert host.ask(Load()).result == Result.OUT_OF_RANGE
    assert config_of(host) == default_image()


def drive(host) -> None:
    host.simulation.set_load(ConstantCurrent(20.0))
    host.run(2.0)


def charge(host) -> None:
    host.ask(Command(CommandId.CHARGE_START))


@pytest.mark.parametrize("work", [drive, charge])
def test_at_work_only_live_fields_are_taken(host, work):
    host.ask(Store())
    work(host)
    live = host.config(fan_ramp_max=1.0, telemetry_period=50)
    reply = host.ask(Write(0, host.config(fan_ramp_max=1.0, t_cell_max=50)))
    assert (reply.result, reply.offset) == (Result.NOT_NOW, NO_OFFSET)
    assert host.ask(Load()).result == Result.NOT_NOW
    assert config_of(host) == default_image()
    assert host.ask(Write(0, live)).result == Result.DONE
    assert config_of(host) == live


def test_from_the_precharge_on_the_car_is_at_work_and_at_rest_when_the_relays_have_opened(host):
    wanted = host.config(t_cell_max=50)
    host.simulation.set_load(ConstantCurrent(20.0))
    host.run(SLOW_PERIOD_S)  # period of the driver's wishes
    host.run(0.05)
    assert host.simulation.master.relay_state is RelayState.PRECHARGE
    assert host.ask(Write(0, wanted)).result == Result.NOT_NOW
    host.simulation.is_shutdown_open = True
    host.run(0.1)
    assert host.ask(Write(0, wanted)).result == Result.DONE


def test_load_without_a_stored_configuration_is_refused(host):
    assert host.ask(Load()).result == Result.NOTHING_STORED


def test_a_second_store_waits_for_the_first(host):
    host.send(Store())
    sequence = host.send(Store())
    host.run(0.3)
    results = {reply.request_sequence: reply.result for reply in host.replies}
    assert results[sequence] == Result.NOT_NOW
    assert results[sequence - 1] == Result.DONE


def test_worn_pages_are_found_by_reading_back(host):
    host.simulation.board.eeprom.worn_pages = set(range(16))
    assert host.ask(Store()).result == Result.EEPROM_FAILED


def eeprom_with(*slots: bytes) -> Eeprom:
    eeprom, content = Eeprom(), b"".join(slots)
    eeprom.content[: len(content)] = content
    return eeprom


OLD, NEW = (with_value(default_image(), "v_cell_chrg", value_v) for value_v in (4.1, 4.12))
BLANK = b"\xff" * 512


@pytest.mark.parametrize(
    ("slots", "at_start", "slot", "counter"),
    [
        ((), default_image(), 0, 1),
        ((bytes(1024),), default_image(), 0, 1),
        ((BLANK, encode_slot(OLD, 5)), OLD, 0, 6),
        ((encode_slot(OLD, 8), encode_slot(default_image(), 8)), OLD, 1, 9),
    ],
    ids=["never written", "zeros", "only slot 1", "the same counter in both"],
)
def test_a_store_goes_into_the_slot_that_the_specification_names(make_host, slots, at_start, slot, counter):
    eeprom = eeprom_with(*slots)
    before = bytes(eeprom.content)
    host = make_host(eeprom)
    assert config_of(host) == at_start
    assert host.ask(Write(0, NEW)).result == Result.DONE
    assert host.ask(Store()).result == Result.DONE
    assert newest(bytes(eeprom.content)) == StoredConfig(NEW, counter, slot)
    other = slice(512 * (1 - slot), 512 * (2 - slot))
    assert eeprom.content[other] == before[other]


def test_eeprom_can_be_read_over_the_line(host):
    host.ask(Store())
    assert host.ask(Read(EEPROM_READ_BASE, 4)).data == b"VWCF"


@pytest.mark.parametrize(
    ("command", "argument"),
    [
        (CommandId.FAN_OVERRIDE, 3601 << 8),
        (CommandId.BALANCE_CELLS, 8 << 12),
        (CommandId.BALANCE_CELLS, -1),
        (CommandId.FAN_OVERRIDE, -2),
        (CommandId.SET_SOC, 10_001),
        (CommandId.CAN_TX_ENABLE, 256),
        (CommandId.CAN_SEND, 8),
    ],
)
def test_arguments_out_of_range_are_refused(host, command, argument):
    assert host.ask(Command(command, argument)).result == Result.OUT_OF_RANGE
