import numpy as np
import pytest

from firmware_protocol.config_image import default_image, with_value
from firmware_protocol.elcon import ChargerFlags
from simulator.bms_state import ChargingState
from tests.c_master import CBalancer, CCharging
from tests.master_memory import Config, MasterMemory

SETTLE_S = 30.0  # rest before balancing is checked
CONFIG = Config.from_image(default_image())


class Bench:
    """The state machine with a struct around it and nothing else."""

    def __init__(self, config: Config = CONFIG) -> None:
        self.config = config
        self.memory = MasterMemory()
        self.memory.v[:] = 40_000
        self.charging = CCharging(self.memory, CBalancer())
        self.now_s = 0.0
        self.alive = True

    def run(self, seconds: float, v_max: int = 40_000) -> ChargingState:
        for _ in range(round(seconds / 0.1)):
            self.now_s += 0.1
            self.charging.step(self.config, self.now_s, charger_alive=self.alive, v_max=v_max)
        return self.charging.state

    @property
    def asked(self) -> tuple[int, int]:
        return self.memory.charger("i_set"), self.memory.charger("control")


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_waits_for_a_charger_that_shows_itself(bench):
    bench.alive = False
    bench.charging.start(0.0)
    assert bench.run(20) is ChargingState.WAITING
    assert bench.asked == (0, 1)
    bench.alive = True
    assert bench.run(0.2) is ChargingState.CONSTANT_CURRENT


def test_constant_current_rises_to_the_configured_limit_and_not_beyond(bench):
    bench.charging.start(0.0)
    currents = []
    for _ in range(600):
        bench.run(0.1)
        currents.append(bench.asked[0])
    assert max(currents) == 120
    assert max(np.diff(currents)) <= 3
    assert bench.memory.charger("v_set") == 4024


def test_first_cell_at_its_limit_stops_the_current_at_once(bench):
    bench.charging.start(0.0)
    bench.run(60)
    assert bench.run(0.1, v_max=41_500) is ChargingState.BALANCING
    assert bench.asked == (0, 1)


def test_balancing_bleeds_the_high_cells_until_they_are_near_the_lowest(bench):
    bench.charging.start(0.0)
    bench.run(1)
    bench.memory.v[[5, 70]] = 40_300, 40_240
    bench.run(0.1, v_max=41_500)
    assert bench.run(SETTLE_S + 1) is ChargingState.BALANCING
    assert np.flatnonzero(bench.charging.balancer.cells).tolist() == [5]
    bench.memory.v[5] = 40_210
    assert bench.run(1) is ChargingState.BALANCING
    bench.memory.v[5] = 40_190
    assert bench.run(1) is ChargingState.CONSTANT_VOLTAGE
    assert not bench.charging.balancer.cells.any()


def test_missing_cells_are_neither_bled_nor_taken_for_the_lowest(bench):
    bench.charging.start(0.0)
    bench.run(1)
    bench.memory.v[3] = 0
    bench.run(0.1, v_max=41_500)
    assert bench.run(SETTLE_S + 1) is ChargingState.CONSTANT_VOLTAGE
    assert not bench.charging.balancer.cells.any()


def charge_simple_cells(bench: Bench, milliohm: float, start: float) -> tuple[float, int]:
    """Charge cells of 3 mohm with one of `milliohm` among them until done; return its highest [100 uV] and the turns.

    The charger answers a command a second late.
    """
    bench.charging.start(0.0)
    bench.run(0.1)
    ocv, highest, current_a, asked, turns, was_rising = start, 0.0, 0.0, [0] * 10, 0, True
    for _ in range(60_000):
        if not bench.charging.is_active:
            break
        current_a += 0.3 * (asked[-10] / 10 - current_a)
        ocv += current_a * 0.1 * 0.25  # 0.25 counts an ampere second
        bench.memory.v[:] = round(ocv + 30 * current_a)
        v_max = ocv + 10 * milliohm * current_a
        bench.memory.v[30] = round(v_max)
        highest = max(highest, v_max)
        bench.memory.set_charger("i_out", round(current_a * 10))
        bench.run(0.1, v_max=round(v_max))
        asked.append(bench.asked[0] * (1 - bench.asked[1]))
        if asked[-1] != asked[-2]:
            turns += was_rising != (asked[-1] > asked[-2])
            was_rising = asked[-1] > asked[-2]
    return highest, turns


@pytest.mark.parametrize("milliohm", [2, 3, 6, 12, 23, 40])
@pytest.mark.parametrize("start", [40_500.0, 41_380.0, 41_460.0])
def test_no_cell_is_lifted_over_its_limit_and_the_current_does_not_chatter(bench, milliohm, start):
    highest, turns = charge_simple_cells(bench, milliohm, start)
    assert bench.charging.state is ChargingState.DONE
    assert 41_440 < highest < 41_510
    assert turns < 60
    assert bench.asked == (0, 1)


@pytest.mark.parametrize("i_chrg_max", [0.5, 1, 2, 3, 5, 6, 12])
def test_charging_ends_at_any_current(i_chrg_max):
    bench = Bench(Config.from_image(with_value(default_image(), "i_chrg_max", i_chrg_max)))
    highest, _ = charge_simple_cells(bench, 3, 41_300.0)
    assert bench.charging.state is ChargingState.DONE
    assert 41_400 < highest < 41_510


def test_cells_stay_below_the_trip_where_the_end_of_charge_is_set_to_it():
    config = Config.from_image(with_value(default_image(), "v_cell_chrg", 4.2))
    bench = Bench(config)
    highest, _ = charge_simple_cells(bench, 3, 41_800.0)
    assert bench.charging.state is ChargingState.DONE
    assert highest < config.v_cell_max - 10
    assert highest > config.v_cell_max - 60


@pytest.mark.parametrize("flag", [ChargerFlags.HARDWARE, ChargerFlags.INPUT_VOLTAGE, ChargerFlags.BATTERY])
def test_a_charger_that_reports_a_fault_ends_charging(bench, flag):
    bench.charging.start(0.0)
    bench.run(5)
    bench.memory.set_charger("flags", flag)
    assert bench.run(0.1) is ChargingState.FAULT
    assert bench.asked == (0, 1)


def test_a_charger_that_is_not_heard_any_more_ends_charging(bench):
    bench.charging.start(0.0)
    bench.run(5)
    bench.alive = False
    assert bench.run(0.1) is ChargingState.FAULT


def test_stop_and_start_again(bench):
    bench.charging.start(0.0)
    bench.run(5)
    bench.charging.stop(bench.now_s)
    assert bench.charging.state is ChargingState.OFF
    bench.charging.start(bench.now_s)
    assert bench.run(1) is ChargingState.CONSTANT_CURRENT
