"""Items know which bus they came from; the number survives a session's file, which keeps ids of 32 bits."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.sources.items import BUS_SHIFT, MOST_BUSES, CanFault, CanItem, LinkChange, SerialItem, bus_of
from firmware_protocol.framing import BadFrame, BadReason
from firmware_protocol.memory_map import CAN_ID_EXTENDED

BUSES = st.integers(0, MOST_BUSES - 1)


@given(st.integers(0, 0x1FFFFFFF), BUSES)
def test_a_29_bit_id_and_its_bus_do_not_touch(can_id: int, bus: int) -> None:
    wire_id = can_id | CAN_ID_EXTENDED | bus << BUS_SHIFT
    assert wire_id < 1 << 32
    assert bus_of(CanItem(0, 0, wire_id, b"")) == bus
    assert wire_id & 0x1FFFFFFF == can_id
    assert wire_id >> 31 == 1


@given(st.integers(0, 0x7FF), BUSES)
def test_an_11_bit_id_stays_one_on_every_bus(can_id: int, bus: int) -> None:
    wire_id = can_id | bus << BUS_SHIFT
    assert bus_of(CanItem(0, 0, wire_id, b"")) == bus
    assert wire_id >> 31 == 0


@pytest.mark.parametrize("bus", range(MOST_BUSES))
def test_what_a_link_says_of_itself_names_its_bus(bus: int) -> None:
    assert bus_of(LinkChange(0, 0, "can", "open", bus=bus)) == bus
    assert bus_of(CanFault(0, 0, "active", 0, bus=bus)) == bus


def test_the_line_is_of_no_other_bus() -> None:
    assert bus_of(SerialItem(0, 0, BadFrame(BadReason.CRC, b""))) == 0
    assert bus_of(LinkChange(0, 0, "rs232", "open")) == 0
