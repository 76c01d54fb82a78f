"""The EEPROM after a power cut at every byte of a store: the old configuration or the new one, never a mixture."""

import numpy as np
import pytest

from firmware_protocol.config_image import default_image, with_value
from firmware_protocol.eeprom import newest, plan_store
from firmware_protocol.framing import encode_frame
from firmware_protocol.memory_map import CONFIG_SIZE
from firmware_protocol.messages import Write, encode_request
from simulator.board import Board
from simulator.eeprom import PAGE_WRITE_S, Eeprom
from simulator.master import VirtualMaster
from simulator.vehicle import PASS_S

OLD = with_value(default_image(), "v_cell_chrg", 4.1)
NEW = with_value(with_value(default_image(), "v_cell_chrg", 4.12), "telemetry_period", 50)


class FixedChance:
    """Breaks a page off after so many bytes."""

    def __init__(self, n_bytes: int) -> None:
        self._given = [n_bytes, 0x5A]

    def integers(self, high: int) -> int:
        return min(self._given.pop(0), high - 1)


def car_with(eeprom: Eeprom) -> VirtualMaster:
    return VirtualMaster(Board(eeprom, np.random.default_rng(1)), now_s=0.0)


def begin_store(eeprom: Eeprom) -> VirtualMaster:
    """Boot with the old configuration, put the new one in force and begin to store it."""
    master = car_with(eeprom)
    kind, body = encode_request(Write(0, NEW))
    master.receive(encode_frame(kind, 1, 0, body), 0.0)
    assert master.store_config(0.0)
    return master


def run(master: VirtualMaster, until_s: float) -> None:
    for k in range(round(until_s / PASS_S) + 1):
        while master.next_frame(PASS_S * k) is not None:
            pass
        master.measure(PASS_S * k, PASS_S, 0.0)


@pytest.fixture
def start() -> bytes:
    eeprom = Eeprom()
    for image in (OLD, OLD):  # both slots in use
        for page in plan_store(bytes(eeprom.content), image):
            eeprom.write(page.offset, page.data)
    return bytes(eeprom.content)


def test_a_cut_at_any_byte_leaves_the_old_or_the_new_configuration(start):
    n_pages, seen = len(plan_store(start, NEW)), set()
    for page in range(n_pages):
        for n_bytes in range(65):
            eeprom = CutEeprom(page)
            eeprom.content[:] = start
            master = begin_store(eeprom)
            run(master, 2 * n_pages * PAGE_WRITE_S)
            eeprom.lose_power(FixedChance(n_bytes))
            found = newest(bytes(eeprom.content))
            assert found is not None
            assert found.image in (OLD, NEW), f"cut after byte {n_bytes} of page {page}"
            assert bytes(car_with(eeprom).image[:CONFIG_SIZE]) == found.image
            seen.add(found.image)
    assert seen == {OLD, NEW}


class CutEeprom(Eeprom):
    """Never ends the page of this number, so that the power is cut within it."""

    def __init__(self, page: int) -> None:
        super().__init__()
        self._pages_left = page

    def is_busy(self, now_s: float) -> bool:
        if self._under_way is not None and self._pages_left == 0:
            return True
        was_busy = self._under_way is not None
        is_busy = super().is_busy(now_s)
        self._pages_left -= was_busy and not is_busy
        return is_busy


def test_the_master_boots_with_what_was_left_and_stores_again(start):
    eeprom = Eeprom()
    eeprom.content[:] = start
    master = begin_store(eeprom)
    run(master, 0.0)
    master.lose_power(FixedChance(10))
    master = begin_store(eeprom)
    run(master, 1.0)
    assert newest(bytes(eeprom.content)).image == NEW
