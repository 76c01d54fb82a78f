"""What is in force is the newer of what the stream brought and what was read; the rules know the bus."""

from dataclasses import dataclass

import pytest

from app.configuration.rules import review
from app.estimation.cell_model.cell_file import load_cell
from app.live.can_trace import CanTrace
from app.service.master import ConfigurationInForce, Rules
from app.sources.items import CanItem
from firmware_protocol.config_image import default_image, image_hash
from firmware_protocol.eeprom import StoredConfig


@dataclass
class FakeConfiguration:
    last_read: tuple[int, bytes] | None = None
    stored: StoredConfig | None = None


@pytest.fixture
def configuration():
    return FakeConfiguration()


@pytest.fixture
def in_force(configuration, clock):
    return ConfigurationInForce(configuration, clock)


def test_before_the_master_speaks_nothing_is_known(in_force):
    assert in_force.image() is None
    assert in_force.age_s() is None
    assert in_force.stored_hash() is None


def test_what_was_read_back_counts_until_the_stream_brings_newer(in_force, configuration, bench, clock, master):
    configuration.last_read = clock.monotonic_ns(), b"\1" * 420
    clock.advance(5)
    assert in_force.image() == b"\1" * 420
    assert in_force.age_s() == pytest.approx(5.0)
    bench.feed(master.config(), master.frame())
    in_force.on_output(bench.outputs[-1], clock.monotonic_ns())
    clock.advance(2)
    assert in_force.image() == bytes(master.image[:420])
    assert in_force.age_s() == pytest.approx(2.0)


def test_what_was_read_after_the_stream_counts(in_force, configuration, bench, clock, master):
    bench.feed(master.config(), master.frame())
    in_force.on_output(bench.outputs[-1], clock.monotonic_ns())
    clock.advance(1)
    configuration.last_read = clock.monotonic_ns(), b"\2" * 420
    assert in_force.image() == b"\2" * 420


def test_the_stored_hash_is_that_of_the_eeprom(in_force, configuration):
    configuration.stored = StoredConfig(default_image(), 3, 0)
    assert in_force.stored_hash() == image_hash(default_image())


def test_the_rules_know_the_periods_measured_on_the_bus():
    trace = CanTrace()
    for number in range(3):
        trace.on_item(CanItem(number * 100_000_000, 0, 0x123, b"\0"))
    rules = Rules(load_cell("samsung-25r-10p"), trace)
    assert rules.context().measured_period_s == {0x123: pytest.approx(0.1)}
    assert rules.review(default_image()) == review(default_image(), rules.context())
