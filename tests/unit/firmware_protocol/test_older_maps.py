"""What an EEPROM, an image and a count of the first memory map mean in the present one."""

import hashlib
import json
import lzma
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_protocol import config_image, eeprom
from firmware_protocol.memory_map import CONFIG, FIELDS, MAP_HASH
from firmware_protocol.older_maps import (
    FIRST_MAP,
    fields_of,
    first_image,
    is_first_image,
    is_known,
    present_image,
)
from simulator.accumulator import AccumulatorParameters
from simulator.eeprom import Eeprom
from simulator.simulation import Simulation

RECORDED = Path(__file__).parents[2] / "recorded" / "first_map"  # by the program of the day before the change
DEFAULT = config_image.default_image()


def made_then(ts_ms):
    return ts_ms.to_bytes(2, "little") + DEFAULT[2:226] + bytes(2) + DEFAULT[228:]


def test_the_first_map_is_the_one_that_its_hash_names():
    lines = [f"{f.name} {f.offset} {f.fmt} {f.count} {f.scale:.9g}\n" for f in fields_of(FIRST_MAP).values()]
    assert hashlib.sha256("".join(lines).encode()).hexdigest()[:16] == FIRST_MAP


def test_it_differs_in_three_fields():
    first = fields_of(FIRST_MAP)
    assert {name for name in FIELDS if FIELDS[name] != first.get(name)} == {"conf.ts", "conf.telemetry_period", "dod"}
    assert set(first) == set(FIELDS) - {"conf.telemetry_period"}
    assert (first["conf.ts"].unit, first["conf.ts"].minimum, first["conf.ts"].maximum) == ("ms", 20, 10000)
    assert first["dod"].scale * 3.6e6 == pytest.approx(1.0)


@pytest.mark.parametrize("unknown", [None, "", "0123456789abcdef"])
def test_what_nobody_knows_is_read_by_the_present_map(unknown):
    assert fields_of(unknown) is FIELDS
    assert fields_of(MAP_HASH.hex()) is FIELDS
    assert (is_known(MAP_HASH.hex()), is_known(FIRST_MAP), is_known("0123456789abcdef")) == (True, True, False)


@given(st.integers(20, 10_000))
def test_the_period_goes_to_its_own_field_and_ts_gets_its_default(ts_ms):
    image = present_image(made_then(ts_ms))
    assert image == config_image.with_value(DEFAULT, "telemetry_period", ts_ms)
    assert config_image.check(image) == []


@given(st.integers(1, 200), st.integers(20, 10_000))
def test_a_present_image_stays(ts, period_ms):
    image = config_image.with_value(config_image.with_value(DEFAULT, "ts", ts), "telemetry_period", period_ms)
    assert not is_first_image(image)
    assert present_image(bytearray(image)) == image
    assert present_image(present_image(made_then(period_ms))) == present_image(made_then(period_ms))


def test_what_was_out_of_range_then_is_refused_now_by_the_field_that_it_is():
    [error] = config_image.check(present_image(made_then(19)))
    assert error.field == "telemetry_period"
    assert config_image.check(made_then(100))[0].field == "telemetry_period"  # unconverted it is no image of now


@pytest.mark.parametrize("size", [0, 226, 419, 421])
def test_an_image_of_another_size_is_left_alone(size):
    assert present_image(bytes(size)) == bytes(size)


def test_an_eeprom_of_the_first_layout_is_migrated():
    memory = lzma.decompress((RECORDED / "eeprom.bin.xz").read_bytes())
    stored = eeprom.newest(memory)
    assert stored.counter == 1
    values = {name: config_image.unit_value(stored.image, name) for name in ("telemetry_period", "ts", "v_cell_max")}
    assert values == {"telemetry_period": 250, "ts": 100, "v_cell_max": 4.2}


def test_a_car_goes_on_counting_the_charge_that_was_counted_then():
    chip = Eeprom()
    chip.content[:] = lzma.decompress((RECORDED / "eeprom.bin.xz").read_bytes())
    car = Simulation(AccumulatorParameters(start_soc=0.7), eeprom=chip, seed=1)
    car.run_until(0.05)
    car.reset(cause=2)
    car.run_until(2.0)
    dod, soc = (FIELDS[name].unpack(car.master.image)[0] for name in ("dod", "soc"))
    assert soc == 8871
    assert dod * FIELDS["dod"].scale == pytest.approx(10_165_135 / 3.6e6, abs=1e-3)


def test_the_next_store_is_of_the_present_layout_and_leaves_the_old_one_as_a_fallback():
    memory = bytearray(lzma.decompress((RECORDED / "eeprom.bin.xz").read_bytes()))
    wanted = config_image.with_value(eeprom.newest(memory).image, "ts", 50)
    for write in eeprom.plan_store(memory, wanted):
        memory[write.offset : write.offset + len(write.data)] = write.data
    assert [(slot.counter, slot.slot) for slot in eeprom.valid_slots(memory)] == [(2, 1), (1, 0)]
    assert eeprom.newest(memory).image == wanted
    assert memory[512 + 6] == eeprom.LAYOUT_VERSION


def test_the_recorded_images_are_of_the_first_map():
    images = [bytes.fromhex(image) for image in json.loads((RECORDED / "values.json").read_text())["configs"]]
    assert [config_image.unit_value(present_image(image), "telemetry_period") for image in images] == [100, 250]
    assert {CONFIG["ts"].unpack(present_image(image))[0] for image in images} == {100}


def test_a_configuration_goes_to_the_first_map_and_back():
    image = config_image.with_value(DEFAULT, "telemetry_period", 250)
    assert present_image(first_image(image)) == image
    assert first_image(first_image(image)) == first_image(image)


@pytest.mark.parametrize("image", [b"", bytes(5), config_image.with_value(DEFAULT, "ts", 7)])
def test_what_no_first_map_can_tell_stays(image):
    assert first_image(image) == image
