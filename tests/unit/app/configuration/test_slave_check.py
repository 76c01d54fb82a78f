"""A slave against a meter: what is out of tolerance is found, and what the errors have in common is named."""

import pytest

from app.configuration.slave_check import CellReading, SlaveCheckLog, judge, read_slave
from app.errors import ConfigError, MasterSilent, NotNow
from firmware_protocol.memory_map import CHIP_MISSING, FIELDS, MASTER_SIZE

METER_ERROR = 0.2e-3
REFERENCE = [3.80 + 0.001 * i for i in range(12)]


def readings(errors, sigma=0.1e-3, pack=2):
    values = [None if e is None else r + e for r, e in zip(REFERENCE, errors, strict=True)]
    return [CellReading(pack * 12 + i, value, None if value is None else sigma) for i, value in enumerate(values)]


def verdict_of(errors):
    return judge(readings(errors), REFERENCE, "voltage", METER_ERROR)


def errors_with(**off):
    errors = [0.3e-3 * (-1) ** i for i in range(12)]
    for place, error in off.items():
        errors[int(place[1:]) - 1] = error
    return errors


def test_a_slave_within_its_data_sheet_is_good():
    verdict = verdict_of(errors_with(c5=1.35e-3))
    assert (verdict.cause, verdict.out) == ("none", ())
    assert all(cell.is_good for cell in verdict.cells)
    assert verdict.limit == pytest.approx(1.4e-3)


def test_one_cell_beyond_it_is_named_with_its_error():
    verdict = verdict_of(errors_with(c5=-4e-3))
    assert (verdict.cause, verdict.out) == ("cells", (28,))
    assert verdict.cells[4].error == pytest.approx(-4e-3)
    assert [cell.is_good for cell in verdict.cells].count(False) == 1


def test_the_same_share_on_every_cell_is_the_boards_reference():
    verdict = verdict_of([0.003 * r for r in REFERENCE])
    assert verdict.cause == "reference"
    assert verdict.share == pytest.approx(0.003, rel=1e-6)
    assert len(verdict.out) == 12


def test_two_neighbours_off_to_either_side_share_a_wire():
    assert verdict_of(errors_with(c6=5e-3, c7=-4.5e-3)).cause == "wire"
    assert verdict_of(errors_with(c6=5e-3, c8=-4.5e-3)).cause == "cells"
    assert verdict_of(errors_with(c6=5e-3, c7=4.5e-3)).cause == "cells"


def test_what_is_missing_on_either_side_is_not_judged():
    verdict = judge(readings(errors_with(c1=None)), [*REFERENCE[:11], None], "voltage", METER_ERROR)
    assert [verdict.cells[i].is_good for i in (0, 11)] == [None, None]
    assert [verdict.cells[i].error for i in (0, 11)] == [None, None]
    assert verdict.cause == "none"


@pytest.mark.parametrize(
    ("reference", "meter_error", "field"),
    [
        ([None] * 12, 0.0, "reference"),
        (REFERENCE[:11], 0.0, "reference"),
        ([38.0, *REFERENCE[1:]], 0.0, "reference[0]"),
        ([float("nan"), *REFERENCE[1:]], 0.0, "reference[0]"),
        (REFERENCE, 0.02, "meter_error"),
        (REFERENCE, float("nan"), "meter_error"),
    ],
)
def test_what_cannot_be_a_reference_is_refused_by_name(reference, meter_error, field):
    with pytest.raises(ConfigError) as caught:
        judge(readings(errors_with()), reference, "voltage", meter_error)
    assert caught.value.field == field


def test_only_cells_that_the_slave_measures_can_be_compared():
    with pytest.raises(ConfigError, match="that the slave measures"):
        judge(readings([None] * 12), REFERENCE, "voltage", 0.0)


def test_a_reading_that_moves_is_refused():
    with pytest.raises(NotNow, match="cell 1 is not steady"):
        judge(readings(errors_with(), sigma=10e-3), REFERENCE, "voltage", METER_ERROR)


class Memory:
    """Answers READ out of an image, as the master does."""

    def __init__(self):
        self.image = bytearray(MASTER_SIZE)
        self.put("slave[2].status", 1)
        self.put("slave[2].cvr", *(38000 + 10 * i for i in range(12)))
        self.put("t", *([20] * 24 + [-5, *range(21, 32)] + [20] * 60))
        self.reads = 0

    def put(self, name, *values):
        FIELDS[name].pack_into(self.image, values)

    def read(self, offset, length):
        self.reads += 1
        return bytes(self.image[offset : offset + length])


def read(memory, quantity="voltage", pack=2):
    return read_slave(memory, pack, quantity, sleep=lambda _: None)


def test_voltages_are_the_converters_own_and_temperatures_the_masters():
    found = read(Memory())
    assert [(r.cell, r.value, r.sigma) for r in found[:2]] == [
        (24, pytest.approx(3.8), pytest.approx(0)),
        (25, pytest.approx(3.801), pytest.approx(0)),
    ]
    assert [r.value for r in read(Memory(), "temperature")] == [-5, *range(21, 32)]


def test_a_cell_without_a_measurement_has_no_reading():
    memory = Memory()
    memory.put("slave[2].cvr", CHIP_MISSING, 0, *[38000] * 10)
    assert [r.value is None for r in read(memory)] == [True, True, *[False] * 10]


@pytest.mark.parametrize(
    ("name", "values", "words"),
    [
        ("slave[2].status", (255,), "no response from the slave of pack 3"),
        ("i_fs", (500,), "a current of 5.0 A flows"),
        ("i_fs", (-500,), "a current of -5.0 A flows"),
        ("slave[2].cfgr", (0, 0, 0, 0, 4, 0), "cells of pack 3 are balancing"),
        ("slave[2].cfgr", (0, 0, 0, 0, 0, 8), "cells of pack 3 are balancing"),
    ],
)
def test_no_slave_is_read_while_its_readings_would_mislead(name, values, words):
    memory = Memory()
    memory.put(name, *values)
    with pytest.raises(NotNow, match=words):
        read(memory)


def test_a_pack_that_is_none_is_refused():
    with pytest.raises(ConfigError, match="pack"):
        read(Memory(), pack=8)


def test_a_master_that_falls_silent_is_no_reading():
    class Silent(Memory):
        def read(self, offset, length):
            if self.reads > 5:
                raise MasterSilent("no reply")
            return super().read(offset, length)

    with pytest.raises(MasterSilent):
        read(Silent())


def test_checks_are_kept_newest_first_and_a_torn_line_costs_one(tmp_path):
    log = SlaveCheckLog(tmp_path)
    for pack, errors in ((2, errors_with(c5=-4e-3)), (2, errors_with()), (3, errors_with())):
        log.append(1_000, "ada", pack, "voltage", "bench", METER_ERROR, "", verdict_of(errors))
    assert [check.number for check in log.checks(2, "voltage")] == [2, 1]
    assert [check.verdict.out for check in log.checks(2)] == [(), (28,)]
    assert log.checks(2, "temperature") == []
    assert log.checks(2)[1].verdict == verdict_of(errors_with(c5=-4e-3))
    path = tmp_path / "slave-checks.jsonl"
    path.write_bytes(path.read_bytes()[:-20])
    again = SlaveCheckLog(tmp_path)
    again.append(2_000, "bob", 3, "temperature", "", 0.5, "after the repair", verdict_of(errors_with()))
    assert [(c.number, c.who) for c in again.checks()] == [(4, "bob"), (2, "ada"), (1, "ada")]
