from dataclasses import replace

import pytest

from firmware_protocol.config_image import default_image
from tests.c_master import CSocCounter
from tests.master_memory import Config

CONFIG = Config.from_image(default_image())


@pytest.fixture
def counter() -> CSocCounter:
    return CSocCounter()


def test_counter_starts_only_at_rest(counter):
    counter.start_from_rest(CONFIG, 37_420, 500)
    assert not counter.is_started
    counter.start_from_rest(CONFIG, 37_420, 30)
    assert counter.soc_counts(CONFIG) == 5000


def test_counter_counts_ampere_hours_of_the_configured_capacity(counter):
    counter.set_soc(CONFIG, 8000)
    for _ in range(36_000):
        counter.count(CONFIG, 250)  # 2.5 A for an hour, a mean each 100 ms: a tenth of 25 Ah
    assert counter.soc_counts(CONFIG) == 7000
    assert counter.dod_uah == 0.3 * 25 * 1e6


def test_a_mean_counts_for_as_long_as_its_samples_took(counter):
    for ts, uah in ((1, 10), (50, 500), (200, 2000)):
        counter.set_soc(CONFIG, 10_000)
        counter.count(replace(CONFIG, ts=ts), 3600)  # 36 A
        assert counter.dod_uah == uah


def test_what_is_less_than_a_count_is_not_lost_in_either_direction(counter):
    counter.set_soc(CONFIG, 5000)
    start, single = counter.dod_uah, replace(CONFIG, ts=1)
    for _ in range(359):
        counter.count(single, 1)
    assert counter.dod_uah == start
    counter.count(single, 1)
    assert counter.dod_uah == start + 1
    counter.count(single, -1)
    assert counter.dod_uah == start


def test_a_count_is_one_microampere_hour_as_in_the_source(counter):
    # figure 4.1.1 of the thesis: dod 24079, soc 9991, c_avg 2500
    counter.start_from_journal(24_079)
    assert CONFIG.c_avg == 2500
    assert counter.soc_counts(CONFIG) == 9991


def test_counter_stays_between_empty_and_full(counter):
    counter.set_soc(CONFIG, 100)
    for _ in range(36_000):
        counter.count(CONFIG, 30_000)
    assert counter.soc_counts(CONFIG) == 0
    for _ in range(360_000):
        counter.count(CONFIG, -30_000)
    assert counter.soc_counts(CONFIG) == 10_000
