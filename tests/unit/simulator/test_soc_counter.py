import pytest

from firmware_protocol.config_image import default_image
from simulator.memory import Config
from simulator.soc_counter import OCV_SOC, OCV_V, SocCounter, soc_from_rest

CONFIG = Config.from_image(default_image())


def test_soc_from_voltage_is_monotone_and_hits_its_table():
    assert [soc_from_rest(volts) for volts in OCV_V] == pytest.approx(OCV_SOC)
    assert (OCV_V[1:] > OCV_V[:-1]).all()


def test_counter_starts_only_at_rest():
    counter = SocCounter()
    counter.start_from_rest(CONFIG, 37_420, 500)
    assert not counter.is_started
    counter.start_from_rest(CONFIG, 37_420, 30)
    assert counter.soc_counts(CONFIG) == 5000


def test_counter_counts_ampere_hours_of_the_configured_capacity():
    counter = SocCounter()
    counter.set_soc(CONFIG, 0.8)
    for _ in range(3600):
        counter.count(CONFIG, 250, 1.0)  # 2.5 A for an hour: a tenth of 25 Ah
    assert counter.soc_counts(CONFIG) == 7000
    assert counter.dod_mas == pytest.approx(0.3 * 25 * 3.6e6)


def test_counter_stays_between_empty_and_full():
    counter = SocCounter()
    counter.set_soc(CONFIG, 0.01)
    counter.count(CONFIG, 30_000, 3600)
    assert counter.soc_counts(CONFIG) == 0
    counter.count(CONFIG, -30_000, 36_000)
    assert counter.soc_counts(CONFIG) == 10_000
