import numpy as np
import pytest

from firmware_protocol.memory_map import FIELDS
from simulator.accumulator import AccumulatorParameters
from simulator.eeprom import ERASED, PAGE_WRITE_S, SIZE, Eeprom
from simulator.errors import PortError
from simulator.simulation import Simulation
from tests.spec_codec import journal_entry


def test_content_outlives_the_chip_object(tmp_path):
    path = tmp_path / "folder" / "eeprom.bin"
    Eeprom(path).write(130, b"hello")
    assert Eeprom(path).read(128, 8) == bytes([ERASED, ERASED]) + b"hello" + bytes([ERASED])
    assert path.stat().st_size == SIZE


def test_a_write_beyond_the_page_wraps_to_its_start():
    eeprom = Eeprom()
    eeprom.write(62, b"abcd")
    assert eeprom.read(0, 2) == b"cd"
    assert eeprom.read(62, 3) == b"ab" + bytes([ERASED])


def test_reading_beyond_the_end_starts_again():
    eeprom = Eeprom()
    eeprom.write(0, b"x")
    assert eeprom.read(SIZE - 1, 2) == bytes([ERASED]) + b"x"


def test_a_worn_page_keeps_what_it_held():
    eeprom = Eeprom()
    eeprom.worn_pages = {1}
    eeprom.write(64, b"x")
    assert eeprom.read(64, 1) == bytes([ERASED])


def test_a_page_takes_five_milliseconds():
    eeprom = Eeprom()
    eeprom.begin_write(0, b"a", now_s=1.0)
    assert eeprom.is_busy(1.0 + 0.9 * PAGE_WRITE_S)
    assert eeprom.read(0, 1) == bytes([ERASED])
    assert not eeprom.is_busy(1.0 + PAGE_WRITE_S)
    assert eeprom.read(0, 1) == b"a"


def test_a_power_cut_tears_the_page_under_way():
    outcomes = set()
    for seed in range(60):
        eeprom = Eeprom()
        eeprom.begin_write(0, b"ab", now_s=0.0)
        eeprom.lose_power(np.random.default_rng(seed))
        assert not eeprom.is_busy(0.0)
        outcomes.add(eeprom.read(0, 2)[:1] == b"a")
    assert outcomes == {True, False}


def test_a_file_that_is_no_eeprom_is_refused(tmp_path):
    path = tmp_path / "long.bin"
    path.write_bytes(bytes(SIZE + 1))
    with pytest.raises(PortError, match="32768"):
        Eeprom(path)


def test_a_page_that_the_file_does_not_take_keeps_what_it_held(tmp_path):
    path = tmp_path / "eeprom.bin"
    eeprom = Eeprom(path)
    eeprom.write(0, b"old")
    path.rename(tmp_path / "away")
    eeprom.write(0, b"new")
    assert eeprom.read(0, 3) == b"old"
    (tmp_path / "away").rename(path)
    eeprom.write(0, b"new")
    assert Eeprom(path).read(0, 3) == b"new"


def counted(*entries: tuple[int, bytes]) -> int:
    """What the firmware takes for the charge drawn after a reset, with these bytes in its journal."""
    chip = Eeprom()
    for offset, data in entries:
        chip.write(offset, data)
    car = Simulation(AccumulatorParameters(start_soc=0.7), eeprom=chip, seed=1)
    car.run_until(0.05)
    car.reset(cause=2)
    car.run_until(2.0)
    return FIELDS["dod"].unpack(car.master.image)[0]


@pytest.mark.parametrize("counters", [(990, 496, 3), (3, 496, 990)])
def test_the_newest_entry_of_the_journal_counts_wherever_it_stands(counters):
    entries = [journal_entry(counter, 1000 * counter, 9000) for counter in counters]
    assert counted(*entries) == pytest.approx(990_000, abs=100)


@pytest.mark.parametrize("cut", [0, 1, 8, 15, 19])
def test_a_torn_entry_of_the_journal_leaves_the_one_before(cut):
    offset, data = journal_entry(8, 6_000_000, 8999)
    assert counted(journal_entry(7, 5_000_000, 9000), (offset, data[:cut])) == pytest.approx(5_000_000, abs=100)
