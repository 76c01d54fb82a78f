import pytest

from firmware_protocol import config_image
from firmware_protocol.errors import DecodeError, EncodeError
from firmware_protocol.memory_map import CAN_ID_EXTENDED, CONFIG, CONFIG_FIELDS, CONFIG_SIZE

FULL_BUFFER = "1..200 sample: size of the current sample buffer"
DEFAULT = config_image.default_image()


def errors_of(name, value):
    return [
        (error.field, error.element, error.offset)
        for error in config_image.check(config_image.with_raw(DEFAULT, name, value))
    ]


def row_with(name, element, raw):
    flat = list(CONFIG[name].unpack(DEFAULT))
    flat[element] = raw
    shape = CONFIG[name].shape
    return flat if len(shape) == 1 else [flat[i * shape[1] : (i + 1) * shape[1]] for i in range(shape[0])]


def test_default_image_is_what_the_master_was_documented_with():
    assert len(DEFAULT) == 420
    assert DEFAULT[0:8].hex(" ", 2) == "6400 a861 10a4 1ca2"  # ts 100 ms, 2.5 V, 4.2 V, 4.15 V
    assert (DEFAULT[8], DEFAULT[9]) == (256 - 15, 45)
    assert DEFAULT[38:40] == bytes([7, 2])
    assert DEFAULT[40:44] == bytes([0xF4, 0xE5, 0x06, 0x98])  # 0x1806E5F4 as 29 bit


def test_default_image_is_accepted():
    assert config_image.check(DEFAULT) == []


@pytest.mark.parametrize("field", [f for f in CONFIG_FIELDS if f.minimum is not None], ids=lambda f: f.name)
def test_every_field_is_refused_just_outside_its_range(field):
    low, high = -(1 << 8 * field.item_size - 1), (1 << 8 * field.item_size) - 1
    for raw in (field.minimum - 1, field.maximum + 1):
        image = bytearray(DEFAULT)
        signed = field.fmt.islower()
        if not (low if signed else 0) <= raw <= (high >> 1 if signed else high):
            continue
        image[field.offset : field.offset + field.item_size] = raw.to_bytes(field.item_size, "little", signed=signed)
        assert (field.name, field.offset) in {(e.field, e.offset) for e in config_image.check(image)}


def test_error_speaks_the_fields_unit():
    [error] = config_image.check(config_image.with_raw(DEFAULT, "ts", 201))
    assert (error.value, error.limit) == (201, "1..200 sample")
    why = "size of the current sample buffer"
    assert error.message == f"ts = 201 sample, allowed: 1..200 sample: {why}"
    error = config_image.check(config_image.with_raw(DEFAULT, "v_cell_max", 46000))[0]
    assert (error.value, error.limit) == (4.6, "3..4.5 V")


@pytest.mark.parametrize(
    ("name", "value", "raw"),
    [
        ("v_cell_max", 4.15, 41500),
        ("v_cell_max", 4.15004, 41500),
        ("v_cell_max", 4.15006, 41501),
        ("t_cell_min", -7.0, -7),
        ("i_disc_min", -100, -10000),
        ("i_gain", 0.2424, 12120),
        ("fan_ramp_max", 224 / 255, 224),
    ],
)
def test_value_in_unit_rounds_to_the_nearest_count(name, value, raw):
    assert config_image.raw_value(config_image.with_value(DEFAULT, name, value), name) == raw


@pytest.mark.parametrize("field", CONFIG_FIELDS, ids=lambda f: f.name)
def test_what_is_read_in_units_can_be_written_back(field):
    value = config_image.unit_value(DEFAULT, field.name)
    assert config_image.with_value(bytes(DEFAULT), field.name, value) == DEFAULT
    assert config_image.with_raw(DEFAULT, field.name, config_image.raw_value(DEFAULT, field.name)) == DEFAULT


@pytest.mark.parametrize("value", [[1] * 8, [[1] * 8] * 7, 3, [[1] * 7 + ["1"]] * 8, [[True] * 8] * 8])
def test_wrong_shape_or_type_is_refused(value):
    with pytest.raises(EncodeError):
        config_image.with_raw(DEFAULT, "can_tx_msg_data", value)


@pytest.mark.parametrize(
    ("name", "value", "field", "wrong", "limit"),
    [
        ("ts", 65536, "ts", 65536, "a whole number of counts, 0..65535"),
        ("ts", -1, "ts", -1, "a whole number of counts, 0..65535"),
        ("ts", 1.5, "ts", 1.5, "a whole number of counts, 0..65535"),
        ("t_cell_min", 128, "t_cell_min", 128, "a whole number of counts, -128..127"),
        ("i_disc_min", -32769, "i_disc_min", -32769, "a whole number of counts, -32768..32767"),
        ("can_tx_msg_id", [0] * 7 + [1 << 32], "can_tx_msg_id[7]", 1 << 32, "a whole number of counts, 0..4294967295"),
        ("can_tx_msg_len", [0] * 7, "can_tx_msg_len", [0] * 7, "an array of 8"),
        ("can_tx_msg_data", [[0] * 8] * 7, "can_tx_msg_data", [[0] * 8] * 7, "an array of 8 by 8"),
        ("ts", True, "ts", True, "a number"),
        ("ts", [1], "ts", [1], "a number"),
        ("none", 1, "field", "none", "unknown configuration field"),
    ],
)
def test_a_count_that_does_not_fit_names_its_element_and_limit(name, value, field, wrong, limit):
    with pytest.raises(EncodeError) as refused:
        config_image.with_raw(DEFAULT, name, value)
    assert (refused.value.field, refused.value.value, refused.value.limit) == (field, wrong, limit)


@pytest.mark.parametrize(
    ("name", "value", "raw"),
    [
        ("ts", 0, 0),
        ("ts", 65535, 65535),
        ("t_cell_min", -128, -128),
        ("t_cell_min", 127, 127),
        ("i_disc_min", -32768, -32768),
        ("can_tx_msg_id", (0,) * 7 + (0xFFFFFFFF,), [0] * 7 + [0xFFFFFFFF]),
    ],
)
def test_counts_at_the_ends_of_their_type_fit(name, value, raw):
    assert config_image.raw_value(config_image.with_raw(DEFAULT, name, value), name) == raw


@pytest.mark.parametrize(
    ("name", "value", "field", "wrong", "limit"),
    [
        ("t_cell_min", -7.4, "t_cell_min", -7.4, "a whole number, -40..40 degC"),
        ("v_cell_max", 4.50006, "v_cell_max", 4.50006, "3..4.5 V"),
        ("v_cell_max", float("inf"), "v_cell_max", float("inf"), "3..4.5 V"),
        ("ts", 100.5, "ts", 100.5, "a whole number, 1..200 sample"),
        ("v_cell_max", 10**400, "v_cell_max", 10**400, "3..4.5 V"),
        ("ts", 10**400, "ts", 10**400, FULL_BUFFER),
        ("ts", 201, "ts", 201, FULL_BUFFER),
        ("telemetry_period", 19, "telemetry_period", 19, "20..10000 ms"),
        ("can_tx_msg_len", [8] * 7 + [9], "can_tx_msg_len[7]", 9, "0..8 byte"),
        ("can_tx_msg_data", [[0] * 8] * 7 + [[0] * 7 + [-1]], "can_tx_msg_data[7][7]", -1, "0..65535"),
    ],
)
def test_a_value_that_does_not_fit_names_its_element_and_limit(name, value, field, wrong, limit):
    with pytest.raises(EncodeError) as refused:
        config_image.with_value(DEFAULT, name, value)
    assert (refused.value.field, refused.value.value, refused.value.limit) == (field, wrong, limit)


def test_one_value_alone_becomes_its_count_or_names_its_field():
    assert config_image.to_raw(CONFIG["v_cell_max"], 4.15) == 41500
    assert config_image.to_raw(CONFIG["ts"], 200) == 200
    for name, value, limit in (
        ("ts", 100.5, "a whole number, 1..200 sample"),
        ("ts", 201, FULL_BUFFER),
        ("telemetry_period", 10_001, "20..10000 ms"),
        ("v_cell_max", float("nan"), "3..4.5 V"),
        ("v_cell_max", 10**400, "3..4.5 V"),
    ):
        with pytest.raises(EncodeError) as refused:
            config_image.to_raw(CONFIG[name], value)
        assert (refused.value.field, refused.value.limit) == (name, limit)
        assert refused.value.value is value


def test_images_may_be_changed_in_all_byte_types():
    for image in (bytearray(DEFAULT), memoryview(DEFAULT)):
        assert config_image.unit_value(config_image.with_value(image, "ts", 50), "ts") == 50


def test_arrays_are_nested_as_their_shape():
    rows = config_image.raw_value(DEFAULT, "can_tx_msg_data")
    assert [len(row) for row in rows] == [8] * 8
    assert rows[1][:2] == [2982, 2983]


def test_unknown_field_is_refused():
    with pytest.raises(EncodeError, match="no_such"):
        config_image.unit_value(DEFAULT, "no_such")


def test_difference_names_the_element_its_byte_and_both_values():
    after = config_image.with_value(DEFAULT, "v_cell_max", 4.15)
    after = config_image.with_raw(after, "can_tx_msg_data", row_with("can_tx_msg_data", 9, 7))
    first, second = config_image.difference(DEFAULT, after)
    assert (first.field, first.element, first.offset, first.before, first.after, first.unit) == (
        "v_cell_max",
        None,
        4,
        4.2,
        4.15,
        "V",
    )
    assert (second.field, second.element, second.offset, second.before, second.after, second.unit) == (
        "can_tx_msg_data",
        9,
        96 + 18,
        2983,
        7,
        "",
    )


def test_padding_neither_differs_nor_changes_the_name_of_an_image():
    noisy = bytearray(DEFAULT)
    noisy[225] = 0xAA
    assert config_image.difference(DEFAULT, noisy) == []
    assert config_image.image_hash(noisy) == config_image.image_hash(DEFAULT)
    assert config_image.canonical(noisy) == DEFAULT


def test_hash_changes_with_any_byte_of_a_field():
    names = {config_image.image_hash(DEFAULT)}
    for position in set(range(CONFIG_SIZE)) - {225}:
        changed = bytearray(DEFAULT)
        changed[position] ^= 1
        names.add(config_image.image_hash(changed))
    assert len(names) == CONFIG_SIZE - 1 + 1
    assert all(len(name) == 16 for name in names)


@pytest.mark.parametrize(
    ("changes", "field", "element", "value", "limit", "why"),
    [
        ({"telemetry_period": 19}, "telemetry_period", None, 19, "20..10000 ms", "limit of the master"),
        ({"ts": 201}, "ts", None, 201, "1..200 sample", "size of the current sample buffer"),
        ({"ts": 0}, "ts", None, 0, "1..200 sample", "size of the current sample buffer"),
        ({"v_cell_min": 40000, "v_cell_max": 40000, "v_cell_chrg": 40000}, "v_cell_min", None, 4.0,
         "below v_cell_max = 4.0 V", "no voltage would be within both limits"),
        ({"v_cell_chrg": 42001}, "v_cell_chrg", None, 4.2001, "at most v_cell_max = 4.2 V",
         "charging would end in a trip"),
        ({"t_cell_min": 40, "t_cell_max": 40}, "t_cell_min", None, 40, "below t_cell_max = 40 degC",
         "no temperature would be within both limits"),
        ({"i_disc_min": 0, "i_disc_max": 0}, "i_disc_min", None, 0.0, "below i_disc_max = 0.0 A",
         "no current would be within both limits"),
        ({"i_chrg_min": 1201}, "i_chrg_min", None, 12.01, "at most i_chrg_max = 12.0 A",
         "no charging current would be within both limits"),
        ({"fan_ramp_min": 225}, "fan_ramp_min", None, 0.8823529412, "at most fan_ramp_max = 0.8784313725 duty",
         "hotter cells would get less cooling"),
        ({"can_tx_msg_len": (8,) * 7 + (9,)}, "can_tx_msg_len", 7, 9, "0..8 byte", "limit of the master"),
        ({"fan_ramp_start": 50}, "fan_ramp_start", None, 50, "below fan_ramp_stop = 50 degC",
         "the ramp must rise with temperature"),
        ({"can_tx_msg_id": (1, 1, 1, 1, 1, 1, 1, 0x800)}, "can_tx_msg_id", 7, 0x800, "0..0x7ff",
         "range of an 11-bit ID"),
        ({"can_rx_msg_id": (CAN_ID_EXTENDED | 0x20000000,) + (1,) * 7}, "can_rx_msg_id", 0, 0xA0000000,
         "0..0x1fffffff", "range of a 29-bit ID"),
        ({"can_rx_msg_response": (8,) + (255,) * 7}, "can_rx_msg_response", 0, 8,
         "0..7, 64..71, or 255",
         "only eight messages can be a response"),
    ],
)  # fmt: skip
def test_an_error_says_which_limit_is_broken_and_why(changes, field, element, value, limit, why):
    image = DEFAULT
    for name, raw in changes.items():
        image = config_image.with_raw(image, name, raw)
    [error] = config_image.check(image)
    assert (error.field, error.element, error.value, error.limit, error.why) == (field, element, value, limit, why)
    assert error.offset == CONFIG[field].offset + (element or 0) * CONFIG[field].item_size


@pytest.mark.parametrize(
    ("name", "raw", "limit", "why"),
    [
        ("can_tx_msg_data", 2984, "0..2983, or 65535", "end of the memory map"),
        ("can_tx_msg_data", 65534, "0..2983, or 65535", "end of the memory map"),
        ("can_rx_msg_data", 419, "420..2983, or 65535", "a CAN message must not write the configuration"),
        ("can_rx_msg_data", 2984, "420..2983, or 65535", "a CAN message must not write the configuration"),
    ],
)
def test_a_table_entry_outside_its_place_says_what_is_allowed(name, raw, limit, why):
    [error] = config_image.check(config_image.with_raw(DEFAULT, name, row_with(name, 63, raw)))
    assert (error.element, error.value, error.limit, error.why) == (63, raw, limit, why)


@pytest.mark.parametrize(
    ("name", "element", "raw"),
    [
        ("can_tx_msg_id", 1, 0x7FF),
        ("can_tx_msg_id", 1, CAN_ID_EXTENDED | 0x1FFFFFFF),
        ("can_tx_msg_data", 0, 0),
        ("can_tx_msg_data", 0, 2983),
        ("can_rx_msg_data", 0, 420),
        ("can_rx_msg_data", 0, 2983),
        ("can_rx_msg_response", 1, 7),
        ("can_rx_msg_response", 1, 255),
    ],
)
def test_table_entries_at_their_limits_are_accepted(name, element, raw):
    assert errors_of(name, row_with(name, element, raw)) == []


@pytest.mark.parametrize("pair", [{"i_chrg_min": 1200}, {"fan_ramp_min": 224}, {"v_cell_chrg": 42000}])
def test_limits_that_may_be_equal_are_accepted(pair):
    [(name, raw)] = pair.items()
    assert errors_of(name, raw) == []


def test_errors_come_in_order_of_their_offset():
    image = config_image.with_raw(DEFAULT, "fan_ramp_min", 225)
    image = config_image.with_raw(image, "t_cell_min", 45)
    image = config_image.with_raw(image, "can_brp", 2)
    image = config_image.with_raw(image, "ts", 0)
    assert [error.field for error in config_image.check(image)] == ["ts", "t_cell_min", "t_cell_min", "fan_ramp_min",
                                                                   "can_brp"]  # fmt: skip


@pytest.mark.parametrize("size", [0, 419, 421])
def test_image_of_the_wrong_size_is_refused(size):
    for function in (config_image.check, config_image.image_hash, config_image.canonical):
        with pytest.raises(DecodeError):
            function(bytes(size))
    for images in ((DEFAULT, bytes(size)), (bytes(size), DEFAULT)):
        with pytest.raises(DecodeError) as refused:
            config_image.difference(*images)
        assert (refused.value.what, refused.value.reason) == ("configuration", f"{size} bytes, not 420")
