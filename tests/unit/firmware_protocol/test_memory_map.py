import struct
from itertools import pairwise

import pytest

from firmware_protocol import memory_map
from firmware_protocol.memory_map import BASE_ADDRESS, CONFIG, FIELDS, MASTER_SIZE

# every address that the 2021 master's debugger view prints
ADDRESSES = {
    "conf.can_tx_msg_id": 0x200005D0,
    "conf.can_tx_msg_timing": 0x200005F0,
    "conf.can_tx_msg_len": 0x20000600,
    "conf.can_tx_msg_data": 0x20000608,
    "conf.can_rx_msg_id": 0x2000068C,
    "conf.can_rx_msg_timeout": 0x200006AC,
    "conf.can_rx_msg_len": 0x200006BC,
    "conf.can_rx_msg_response": 0x200006C4,
    "conf.can_rx_msg_data": 0x200006CC,
    "slave[0].status": 0x20000764,
    "slave[0].time": 0x20000768,
    "slave[0].cfgr": 0x200007B0,
    "slave[0].cvr": 0x200007B6,
    "slave[0].avr": 0x200007CE,
    "slave[0].str": 0x200007D4,
    "slave[0].com": 0x200007E0,
    "slave[0].temp": 0x200007E6,
    "v": 0x20000D10,
    "ocv": 0x20000DD0,
    "t": 0x20000E9A,
    "c": 0x20000F04,
    "r_fs": 0x20000FCE,
    "r_fc": 0x2000108E,
}


@pytest.mark.parametrize(("name", "address"), ADDRESSES.items())
def test_field_lies_where_the_debugger_saw_it(name, address):
    assert BASE_ADDRESS + FIELDS[name].offset == address
    assert {field.name: field.offset for field in memory_map.all_fields()}[name] == address - BASE_ADDRESS


def test_sizes_of_the_structs():
    assert FIELDS["soc"].end == MASTER_SIZE == 2984
    assert CONFIG["can_rx_msg_data"].end == memory_map.CONFIG_SIZE == 420
    assert memory_map.CHARGER_OFFSET == memory_map.STATUS_OFFSET + memory_map.STATUS_SIZE
    assert FIELDS["n_slaves"].offset == memory_map.CHARGER_OFFSET + memory_map.CHARGER_SIZE
    assert FIELDS["slave[7].temp"].end + 2 == memory_map.SLAVE_OFFSET + 8 * 180 == FIELDS["i_fs"].offset


def test_fields_follow_each_other_with_only_the_padding_that_arm_c_puts():
    end = 0
    for field in FIELDS.values():
        assert field.offset % field.item_size == 0, field.name
        assert field.offset - end in (0, 1, 2, 3), field.name
        end = field.end
    assert all(a.end <= b.offset for a, b in pairwise(FIELDS.values()))


def test_values_of_the_debugger_view_are_read():
    image = bytearray(MASTER_SIZE)
    struct.pack_into("<i", image, 1884, -5)
    struct.pack_into("<H", image, 2282, 40794)
    struct.pack_into("<b", image, 2386, -8)
    assert FIELDS["i_fs"].unpack(image) == (-5,)
    assert FIELDS["v_max"].unpack(image) == (40794,)
    assert FIELDS["t_min"].unpack(image) == (-8,)
    assert FIELDS["v_max"].scale * 40794 == pytest.approx(4.0794)


def test_arrays_go_in_and_out():
    image = bytearray(MASTER_SIZE)
    values = tuple(range(41000, 41096))
    FIELDS["v"].pack_into(image, values)
    assert FIELDS["v"].unpack(image) == values
    assert image[1896 + 95 * 2 : 2088] == struct.pack("<H", 41095)


@pytest.mark.parametrize("field", memory_map.CONFIG_FIELDS, ids=lambda field: field.name)
def test_every_configuration_field_has_a_range_that_holds_its_default(field):
    assert field.meaning
    assert field.group
    defaults = field.default if isinstance(field.default, tuple) else (field.default,)
    assert len(defaults) == field.count
    assert all(field.minimum <= value <= field.maximum for value in defaults)
    struct.pack(f"<{field.fmt}{field.fmt}", field.minimum, field.maximum)


@pytest.mark.parametrize(
    ("offset", "name", "element", "byte"),
    [
        (0, "conf.ts", 0, 0),
        (1885, "i_fs", 0, 1),
        (1896 + 2 * 36 + 1, "v", 36, 1),
        (96 + 2 * 11, "conf.can_tx_msg_data", 11, 0),
        (444 + 180 * 7 + 82, "slave[7].cvr", 0, 0),
        (2983, "soc", 0, 1),
    ],
)
def test_locate_names_the_byte(offset, name, element, byte):
    field, found_element, found_byte = memory_map.locate(offset)
    assert (field.name, found_element, found_byte) == (name, element, byte)


def test_the_first_and_the_last_byte_of_every_field_are_its_own():
    for field in FIELDS.values():
        assert memory_map.locate(field.offset) == (field, 0, 0)
        assert memory_map.locate(field.end - 1) == (field, field.count - 1, field.item_size - 1)


@pytest.mark.parametrize("offset", [225, 441, 2391, 2984, -1])
def test_padding_and_beyond_is_nobodys(offset):
    assert memory_map.locate(offset) is None


def test_element_names():
    assert memory_map.element_name(FIELDS["soc"], 0) == "soc"
    assert memory_map.element_name(FIELDS["v"], 36) == "v[36]"
    assert memory_map.element_name(CONFIG["can_tx_msg_data"], 11) == "can_tx_msg_data[1][3]"
    assert memory_map.element_name(CONFIG["can_tx_msg_data"], 63) == "can_tx_msg_data[7][7]"
    assert memory_map.element_name(FIELDS["slave[3].cvr"], 5) == "slave[3].cvr[5]"


def test_a_struct_inside_a_longer_image_is_read_and_written_at_its_base():
    image = bytearray(100 + MASTER_SIZE)
    FIELDS["i_fs"].pack_into(image, (-5,), base=100)
    assert image[100 + 1884 : 100 + 1888] == b"\xfb\xff\xff\xff"
    assert sum(image) == 0xFB + 3 * 0xFF
    assert FIELDS["i_fs"].unpack(image, base=100) == (-5,)
    assert FIELDS["i_fs"].unpack(image) == (0,)


def test_map_hash_is_eight_bytes():
    assert len(memory_map.MAP_HASH) == 8
