"""The EEPROM after a power cut at every byte of a store: the old configuration or the new one, never a mixture."""

import numpy as np

from firmware_protocol.config_image import default_image, with_value
from firmware_protocol.eeprom import newest, plan_store
from simulator.board import Board
from simulator.eeprom import Eeprom
from simulator.master import VirtualMaster

OLD = with_value(default_image(), "v_cell_chrg", 4.1)
NEW = with_value(with_value(default_image(), "v_cell_chrg", 4.12), "telemetry_period", 50)


def test_a_cut_at_any_byte_leaves_the_old_or_the_new_configuration():
    start = Eeprom()
    for image in (OLD, OLD):  # both slots in use
        for page in plan_store(bytes(start.content), image):
            start.write(page.offset, page.data)
    pages = plan_store(bytes(start.content), NEW)
    seen = set()
    for index, cut_page in enumerate(pages):
        for n_bytes in range(len(cut_page.data) + 1):
            eeprom = Eeprom()
            eeprom.content[:] = start.content
            for page in pages[:index]:
                eeprom.write(page.offset, page.data)
            eeprom.tear(cut_page.offset, cut_page.data, n_bytes, garbage=0x5A)
            found = newest(bytes(eeprom.content))
            assert found is not None
            assert found.image in (OLD, NEW), f"cut after byte {n_bytes} of page {index}"
            seen.add(found.image)
    assert seen == {OLD, NEW}


def test_the_master_boots_with_what_was_left_and_stores_again():
    eeprom = Eeprom()
    for page in plan_store(bytes(eeprom.content), OLD):
        eeprom.write(page.offset, page.data)
    first, *_ = plan_store(bytes(eeprom.content), NEW)
    eeprom.tear(first.offset, first.data, 10, garbage=0)
    master = VirtualMaster(Board(eeprom, np.random.default_rng(1)), now_s=0.0)
    assert master.memory.config == OLD
    assert master.store.start(1, NEW, now_s=0.0)
    finished = master.store.run(now_s=10.0)
    assert finished is not None
    assert newest(bytes(eeprom.content)).image == NEW
