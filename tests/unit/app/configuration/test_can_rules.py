"""Where each rule about the CAN tables begins, and what it says."""

from dataclasses import replace

import pytest

from app.configuration.can_rules import can_findings, wire_id
from firmware_protocol.can_tables import rx_messages, tx_messages, with_rx_messages, with_tx_messages
from firmware_protocol.config_image import default_image, with_value
from firmware_protocol.memory_map import BYTE_UNUSED

DEFAULT = default_image()
TX, RX = tx_messages(DEFAULT), rx_messages(DEFAULT)
COMMAND, STATUS = 0x9806E5F4, 0x98FF50E5
SOC = (2982, 2983, *[BYTE_UNUSED] * 6)
CHARGER = (432, 433, *[BYTE_UNUSED] * 6)


def tx(image=DEFAULT, index=3, **changes):
    base = replace(TX[index], can_id=0x300, length=2, data_offsets=SOC) if index > 2 else tx_messages(image)[index]
    return with_tx_messages(image, [replace(base, **changes)])


def rx(image=DEFAULT, index=1, **changes):
    base = replace(RX[index], can_id=0x310, length=2, data_offsets=CHARGER) if index else rx_messages(image)[0]
    return with_rx_messages(image, [replace(base, **changes)])


def found(image, received=None):
    return [
        (f.level, f.code, f.error.field, f.error.element, f.error.value, f.error.limit, f.error.why)
        for f in can_findings(image, received or {})
    ]


def test_the_default_tables_have_no_finding():
    assert found(DEFAULT) == []
    assert found(tx()) == []
    assert found(rx()) == []


def test_the_id_on_the_bus_tells_both_formats_apart():
    assert [wire_id(m) for m in (TX[0], TX[1], RX[0])] == [COMMAND, 0x100, STATUS]


OWN = "a unique ID"


@pytest.mark.parametrize(
    ("image", "field", "element", "value", "other"),
    [
        (tx(can_id=0x100), "can_tx_msg_id", 3, 0x100, "tx 2"),
        (rx(can_id=0x101), "can_rx_msg_id", 1, 0x101, "tx 3"),
        (rx(can_id=0x18FF50E5, is_extended=True), "can_rx_msg_id", 1, STATUS, "rx 1"),
    ],
)
def test_an_id_that_another_message_has_names_that_message(image, field, element, value, other):
    why = f"{other} uses this ID: two senders of one ID corrupt each other"
    assert ("error", "id-taken", field, element, value, OWN, why) in found(image)


def test_the_same_number_in_another_format_and_a_message_without_bytes_take_no_id():
    assert found(tx(can_id=0x100, is_extended=True)) == []
    assert found(tx(can_id=0x100, length=0, data_offsets=(BYTE_UNUSED,) * 8)) == []


@pytest.mark.parametrize(
    ("image", "expected"),
    [
        (
            tx(length=0, enabled=True, period_ms=100, data_offsets=(BYTE_UNUSED,) * 8),
            [("error", "empty", "can_tx_msg_len", 3, 0, "1..8 byte", "the message is on at start-up without bytes")],
        ),
        (
            rx(length=0, enabled=True, data_offsets=(BYTE_UNUSED,) * 8),
            [("error", "empty", "can_rx_msg_len", 1, 0, "1..8 byte", "the message is on at start-up without bytes")],
        ),
        (
            rx(index=0, response=5),
            [("error", "empty", "can_tx_msg_len", 5, 0, "1..8 byte", "the message is a response without bytes")],
        ),
        (
            tx(length=1),
            [
                ("error", "length", "can_tx_msg_len", 3, 1, "at least 2 byte",
                 "byte 1 is used but would not be sent"),
                ("warning", "cut", "can_tx_msg_data", 24, 2982,
                 "all bytes of the number, consecutive", "only byte 0 of soc is sent"),
            ],
        ),
        (
            rx(length=1),
            [("error", "length", "can_rx_msg_len", 1, 1, "at least 2 byte",
              "byte 1 is used but would not be received")],
        ),
        (rx(index=0, enabled=False, response=5), []),
    ],
)  # fmt: skip
def test_lengths(image, expected):
    assert found(image) == expected


def test_messages_of_a_charger_have_eight_bytes():
    short = tx(index=0, length=7)
    assert found(short) == [
        ("error", "length", "can_tx_msg_len", 0, 7, "8 byte", "an ElCon charger's command has 8 bytes")
    ]
    short = rx(index=0, length=6)
    assert found(short) == [
        ("error", "length", "can_rx_msg_len", 0, 6, "8 byte", "an ElCon charger's status has 8 bytes")
    ]


@pytest.mark.parametrize(("can_brp", "rate"), [(7, None), (15, None), (3, "1000"), (31, "125"), (8, "444.444")])
def test_a_charger_speaks_250_or_500_kbit_s(can_brp, rate):
    expected = [] if rate is None else [
        ("warning", "charger-rate", "can_brp", None, can_brp, "15 (250 kbit/s) or 7 (500 kbit/s)",
         f"{rate} kbit/s: an ElCon charger supports 250 or 500 kbit/s")
    ]  # fmt: skip
    assert found(with_value(DEFAULT, "can_brp", can_brp)) == expected


def test_without_a_charger_any_bit_rate_is_fine():
    none = rx(tx(index=0, can_id=0x50, is_extended=False), index=0, can_id=0x51, is_extended=False)
    assert found(with_value(none, "can_brp", 3)) == []


def test_a_message_that_is_on_needs_a_period():
    expected = ("warning", "no-period", "can_tx_msg_timing", 3, 0, "1..60000 ms",
                "the message is enabled at start-up but only sent on demand")  # fmt: skip
    assert found(tx(enabled=True, period_ms=0)) == [expected]
    assert found(tx(enabled=True, period_ms=10)) == []
    assert found(tx(enabled=False, period_ms=0)) == []


@pytest.mark.parametrize(("period_ms", "is_fine"), [(0, False), (1, True), (1000, True), (4999, True), (5000, False)])
def test_a_charger_stops_after_five_seconds_without_a_command(period_ms, is_fine):
    image = rx(tx(index=0, period_ms=period_ms), index=0, timeout_ms=0)
    expected = ("error", "charger-period", "can_tx_msg_timing", 0, period_ms, "1..4999 ms",
                "the charger stops after 5 s without a command")  # fmt: skip
    assert found(image) == ([] if is_fine else [expected])
    unused = rx(image, index=0, response=None, timeout_ms=0)
    assert found(unused) == [], "a command that is neither on nor an answer is nobody's"


@pytest.mark.parametrize(("timeout_ms", "is_fine"), [(0, True), (1000, False), (1001, True)])
def test_a_timeout_is_longer_than_the_chargers_period(timeout_ms, is_fine):
    image = rx(index=0, timeout_ms=timeout_ms, response=None)
    expected = ("error", "timeout", "can_rx_msg_timeout", 0, timeout_ms,
                "longer than 1000 ms, the period of an ElCon charger",
                "the message would time out between two frames")  # fmt: skip
    assert found(image) == ([] if is_fine else [expected])


@pytest.mark.parametrize(("timeout_ms", "is_fine"), [(500, False), (501, True)])
def test_a_timeout_is_longer_than_the_period_heard_on_the_bus(timeout_ms, is_fine):
    expected = ("error", "timeout", "can_rx_msg_timeout", 1, timeout_ms,
                "longer than 500 ms, the period received on the bus",
                "the message would time out between two frames")  # fmt: skip
    image = rx(timeout_ms=timeout_ms)
    assert found(image, {0x310: 0.5}) == ([] if is_fine else [expected])
    assert found(image, {0x311: 9.0}) == [], "of another message"
    assert found(rx(timeout_ms=timeout_ms, length=0, data_offsets=(BYTE_UNUSED,) * 8), {0x310: 0.5}) == []


@pytest.mark.parametrize(("period_ms", "is_fine"), [(299, True), (300, False), (60_000, False)])
def test_a_timeout_is_longer_than_the_period_of_the_answer(period_ms, is_fine):
    image = rx(tx(period_ms=period_ms), timeout_ms=300, response=3)
    expected = ("error", "timeout", "can_rx_msg_timeout", 1, 300,
                f"longer than the {period_ms} ms between two responses, tx 4",
                "the response would be disabled before it is sent again")  # fmt: skip
    assert found(image) == ([] if is_fine else [expected])


def test_a_period_is_compared_to_the_millisecond():
    assert [each[1] for each in found(rx(timeout_ms=10_000), {0x310: 10.0})] == ["timeout"]
    assert found(rx(timeout_ms=10_001), {0x310: 10.0}) == []


def test_a_place_without_a_message_hides_none_behind_it():
    image = with_rx_messages(
        DEFAULT, [replace(RX[3], can_id=0x312, length=2, data_offsets=CHARGER, timeout_ms=100)]
    )  # rx 2 and 3 are free
    assert [each[1:4] for each in found(image, {0x312: 0.5})] == [("timeout", "can_rx_msg_timeout", 3)]


def test_the_last_of_many_picked_bytes_counts():
    image = tx(length=2, data_offsets=(440, 441, 442, 443, *[BYTE_UNUSED] * 4))
    assert [each[5:] for each in found(image)] == [("at least 4 byte", "byte 3 is used but would not be sent")]


def test_half_a_number_says_which_byte_is_sent():
    image = tx(length=3, data_offsets=(440, 2983, 2288, *[BYTE_UNUSED] * 5))
    limit = "all bytes of the number, consecutive"
    assert found(image) == [
        ("warning", "cut", "can_tx_msg_data", 25, 2983, limit, "only byte 1 of soc is sent"),
        ("warning", "cut", "can_tx_msg_data", 26, 2288, limit, "only byte 0 of v_tot is sent"),
    ]


@pytest.mark.parametrize(
    ("offset", "name"),
    [(420, "status.flags"), (427, "status.charger_status"), (440, "n_slaves"), (2982, "soc"), (1896, "v")],
)
def test_what_the_master_measures_is_not_for_others_to_write(offset, name):
    image = rx(length=2, data_offsets=(BYTE_UNUSED, offset, *[BYTE_UNUSED] * 6))
    assert found(image) == [
        ("warning", "overwrites", "can_rx_msg_data", 9, offset, "428..439, range of the charger",
         f"{name} is measured or counted by the master and used for protection")
    ]  # fmt: skip


@pytest.mark.parametrize("offset", [428, 439, 441, BYTE_UNUSED])
def test_the_chargers_block_and_padding_are_free(offset):
    assert found(rx(length=1, data_offsets=(offset, *[BYTE_UNUSED] * 7))) == []


def test_bytes_beyond_the_length_write_nothing():
    image = rx(length=1, data_offsets=(430, 1896, *[BYTE_UNUSED] * 6))
    assert [each[1] for each in found(image)] == ["length"]


@pytest.mark.parametrize(
    ("lengths", "level", "load", "limit"),
    [  # one a millisecond, of 85, 95, 105, 65 and 125 bits for 3, 4, 5, 1 and 7 bytes, at 500 kbit/s
        ((7, 7), None, "50 %", ""),
        ((7, 7, 0), "warning", "61 %", "50 %"),
        ((3, 4, 5, 0), "warning", "68 %", "50 %"),
        ((3, 4, 5, 1), "error", "70 %", "70 %"),
        ((7, 7, 7), "error", "75 %", "70 %"),
    ],
)
def test_the_master_leaves_a_share_of_the_bus_to_others(lengths, level, load, limit):
    image = rx(index=0, response=None)
    for index in range(8):
        on = index < len(lengths)
        message = replace(TX[index], can_id=0x400 + index, is_extended=False, enabled=on, period_ms=int(on))
        length = lengths[index] if on else 0
        offsets = (440,) * length + (BYTE_UNUSED,) * (8 - length)
        image = with_tx_messages(image, [replace(message, length=length, data_offsets=offsets)])
    why = f"the master alone would load the bus by {load} at 500 kbit/s; other nodes need capacity too"
    expected = [] if level is None else [(level, "load", "can_tx_msg_timing", 0, 1, f"a bus load below {limit}", why)]
    assert [each for each in found(image) if each[1] == "load"] == expected
