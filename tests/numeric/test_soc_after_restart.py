"""The SOC after a restart: of the master at another charge, of the service, after a silence, and where nothing changed.

The simulated car's own firmware counts and is listened to through the whole pipeline. At every estimate after the
restart the true SOC of every cell lies within three sigma, and the pack within two points: at rest after 16 s, on which
a rest is read, in a drive after two minutes.
"""

import numpy as np
import pytest

from app.live.pipeline_factory import PipelineFactory
from app.sources.items import LinkChange, SerialItem
from firmware_protocol.framing import FrameDecoder
from simulator.accumulator import AccumulatorParameters
from simulator.eeprom import Eeprom
from simulator.loads import ConstantCurrent, Rest
from simulator.race import endurance
from simulator.simulation import Simulation

EPOCH_NS = 1_790_000_000 * 10**9
POWER_ON, WATCHDOG = 0, 1
READ_S = 20.0  # a rest of 16 s and what a boot takes
PACK = slice(24, 36)
FACTORY = PipelineFactory("fused")


def race():
    return endurance(np.random.default_rng(3), n_laps=10)


class Pit:
    """A service and the cars that it listens to, one after the other, on one clock."""

    def __init__(self):
        self._away_s = 0.0
        self.clock_ns = EPOCH_NS
        self._eeprom = Eeprom()
        self.car = None
        self.estimates = None
        self.worst = 0.0  # largest error over its sigma since it was set to 0
        self.serve()

    @property
    def now_ns(self):
        return round((self._away_s + (self.car.now_s if self.car else 0.0)) * 1e9)

    def serve(self, remembered=None, learned=None):
        """Start the service, with what an earlier run learned."""
        self._predictor = FACTORY.predictor(learned, predicts=False)
        self._pipeline = FACTORY.pipeline("serial", "car", predictor=self._predictor, remembered=remembered)
        self._predicted_ns = 0
        self._pipeline.feed(LinkChange(self.now_ns, self.clock_ns + self.now_ns, "rs232", "open"))

    def restart_service(self):
        self.serve(self._pipeline.charge, self._predictor.learned_cells)

    def plug_in(self, soc, load=None, away_s=0.0):
        """Plug in a car that has just been switched on, at a SOC, after so long."""
        self._away_s += away_s + (self.car.now_s if self.car else 0.0)
        parameters = AccumulatorParameters(start_soc=soc)
        self.car = Simulation(parameters, eeprom=self._eeprom, seed=1, step_s=0.1)
        self.car.set_load(load or Rest())
        self.listen()
        self.run(1.0)
        self.car.receive(b"x")

    def listen(self):
        self._decoder = FrameDecoder()
        self.car.serial_out = self._take

    def run(self, seconds):
        self.car.run_until(self.car.now_s + seconds)

    def away(self, seconds):
        """Let the car go on without a listener."""
        self.car.serial_out = None
        self.run(seconds)

    def switch_off(self, cause, off_s):
        """Switch the master off, or reset it."""
        self.car.reset(cause, off_s=off_s)
        self.run(off_s + 0.7)
        self.car.receive(b"x")

    def _take(self, data):
        for frame in self._decoder.feed(data):
            found = self._pipeline.feed(SerialItem(self.now_ns, self.clock_ns + self.now_ns, frame)).estimates
            if found is not None:
                self.estimates = found
                self.worst = max(self.worst, float((np.abs(self.error) / found.soc_sigma).max()))
            if self.now_ns - self._predicted_ns > 1e9:
                self._predicted_ns = self.now_ns
                self._pipeline.predict()

    @property
    def error(self):
        """(96,) SOC less the true one."""
        return self.estimates.soc - self.car.accumulator.soc

    @property
    def pack_error(self):
        return abs(float(self.error.mean()))

    @property
    def sigma(self):
        return float(self.estimates.soc_sigma.mean())


@pytest.fixture
def pit():
    return Pit()


SERVICE = pytest.mark.parametrize("restarts", [False, True], ids=["service goes on", "service restarted"])


@SERVICE
@pytest.mark.parametrize("away_s", [5.0, 600.0])
def test_a_master_restarted_at_another_charge_at_rest(pit, restarts, away_s):
    pit.plug_in(0.89)
    pit.run(40.0)
    if restarts:
        pit.restart_service()
    pit.worst = 0.0
    pit.plug_in(0.85, away_s=away_s)
    pit.run(READ_S)
    assert pit.pack_error < 0.02
    pit.run(20.0)
    assert pit.pack_error < 0.02
    assert pit.worst < 3.0
    assert pit.sigma < 0.02


@pytest.mark.parametrize("load", [None, race()], ids=["at rest", "in a drive"])
def test_a_service_restarted_without_a_clock_at_another_charge(pit, load):
    pit.plug_in(0.9)
    pit.run(40.0)
    pit.clock_ns -= 30 * 86_400 * 10**9
    pit.restart_service()
    pit.worst = 0.0
    pit.plug_in(0.8, load, away_s=3600.0)
    pit.run(READ_S if load is None else 120.0)
    assert pit.pack_error < 0.02
    assert pit.worst < 3.0


@SERVICE
def test_a_master_restarted_at_another_charge_after_a_drive(pit, restarts):
    pit.plug_in(0.965, race())
    pit.run(60.0)
    assert pit.pack_error < 0.02
    if restarts:
        pit.restart_service()
    pit.worst = 0.0
    pit.plug_in(0.888, away_s=30.0)
    pit.run(READ_S)
    assert pit.pack_error < 0.02
    assert pit.worst < 3.0


@SERVICE
def test_a_master_restarted_at_another_charge_in_a_drive(pit, restarts):
    pit.plug_in(0.95)
    pit.run(30.0)
    if restarts:
        pit.restart_service()
    pit.worst = 0.0
    pit.plug_in(0.85, race(), away_s=300.0)
    pit.run(120.0)
    assert pit.pack_error < 0.02
    assert pit.worst < 3.0


@SERVICE
@pytest.mark.parametrize(("load", "moved"), [(ConstantCurrent(60.0), 0.2), (ConstantCurrent(-30.0), -0.1)])
def test_a_master_that_counted_on_in_a_silence(pit, restarts, load, moved):
    pit.plug_in(0.7)
    pit.run(30.0)
    before = pit.car.accumulator.soc.mean()
    pit.car.set_load(load)
    pit.away(300.0)
    pit.car.set_load(Rest())
    pit.run(20.0)
    assert before - pit.car.accumulator.soc.mean() == pytest.approx(moved, abs=0.02)
    if restarts:
        pit.restart_service()
    pit.worst = 0.0
    pit.listen()
    pit.run(1.0)
    assert pit.pack_error < 0.02 or restarts
    pit.run(READ_S)
    assert pit.pack_error < 0.02
    assert pit.worst < 3.0


def test_a_master_switched_off_where_nothing_changed_keeps_the_charge(pit):
    pit.plug_in(0.8)
    pit.run(40.0)
    soc, sigma = pit.estimates.soc.copy(), pit.sigma
    pit.worst = 0.0
    pit.switch_off(POWER_ON, 60.0)
    pit.run(READ_S)
    assert np.abs(pit.estimates.soc - soc).max() < 0.005
    assert pit.sigma < 1.1 * sigma
    assert pit.worst < 3.0


@pytest.mark.parametrize("cause", [POWER_ON, WATCHDOG])
def test_a_master_that_restarts_in_a_drive_that_goes_on_keeps_the_charge(pit, cause):
    pit.plug_in(0.9)
    pit.run(20.0)
    pit.car.set_load(ConstantCurrent(60.0))
    pit.run(30.0)
    error, sigma = pit.error.copy(), pit.sigma
    pit.switch_off(cause, 0.3)
    pit.run(2.0)
    assert np.abs(pit.error - error).max() < 0.005
    assert pit.sigma < 1.1 * sigma


def test_a_pack_that_was_swapped_while_the_master_was_off(pit):
    pit.plug_in(0.9)
    pit.run(40.0)
    others = np.full(96, 0.9)
    others[PACK] = 0.7
    pit.worst = 0.0
    pit.plug_in(others, away_s=900.0)
    pit.run(READ_S)
    assert np.abs(pit.error[PACK]).max() < 0.03
    assert pit.pack_error < 0.02
    assert pit.worst < 3.0
