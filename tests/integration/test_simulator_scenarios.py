"""Every scenario of the library is played, and what happens is what its file says: these events, and no other trip."""

import functools
import math
from dataclasses import replace

import pytest

from firmware_protocol.eeprom import newest
from firmware_protocol.framing import BadFrame, FrameDecoder
from firmware_protocol.memory_map import CONFIG_SIZE, FIELDS
from firmware_protocol.messages import EventCode, EventMessage, MessageType, Result, decode_message
from simulator.bms_state import ChargingState
from simulator.library import find_scenario, library
from simulator.scenario import Scenario
from simulator.scenario_player import ScenarioPlayer
from simulator.vehicle import PASS_S
from tests.campaign import SIZE, of_size
from tests.master_memory import FLAG, Config, MasterMemory

LOOPING_S = 60.0
LIMIT_S = 30_000.0
COARSE = of_size(2, 1, 1)  # passes of `make test` are twice as long where what is expected does not hang on it
NEVER_COARSE = ("blocked-fan", "scrutineering")
LONG = ("charging-cold", "charging-unbalanced")  # hours of charging
in_the_campaign = pytest.mark.skipif(SIZE == "sample", reason="hours of charging: in the campaign")
FINER_STEP_S = {"blocked-fan": 0.5}  # step of long scenarios


class Played:
    """A scenario from its start to its end, with everything that the master told."""

    def __init__(
        self,
        scenario: Scenario,
        *,
        listen: bool = False,
        pass_s: float | None = None,
        until_s: float = LIMIT_S,
    ) -> None:
        self.player = ScenarioPlayer(scenario, step_s=pass_s or step_s(scenario))
        self.simulation = self.player.simulation
        self.simulation.serial_out = self._take
        self._decoder = FrameDecoder()
        self.events: list[tuple[float, EventMessage]] = []
        self.sequences: list[int] = []
        self.bad = 0
        self.highest_v = 0.0
        if listen:
            self.player.run(1.0)
            self.simulation.receive(b"x")
        before_step = self.simulation.before_step

        def watch(at_s: float) -> None:
            self.highest_v = max(self.highest_v, float(self.simulation.accumulator.terminal_voltage_v.max()))
            before_step(at_s)

        self.simulation.before_step = watch
        end_s = LOOPING_S if scenario.loop else until_s
        while not self.player.is_over and self.simulation.now_s < end_s:
            self.player.run(5.0)

    def _take(self, data: bytes) -> None:
        for item in self._decoder.feed(data):
            if isinstance(item, BadFrame):
                self.bad += 1
                continue
            self.sequences.append(item.sequence)
            if item.type == MessageType.EVENT:
                message = decode_message(item)
                assert isinstance(message, EventMessage)
                self.events.append((self.simulation.now_s, message))

    def happened(self, code: EventCode) -> list[tuple[float, EventMessage]]:
        return [(at_s, event) for at_s, event in self.events if event.code == code]


def step_s(scenario: Scenario) -> float:
    """Return a pass length that keeps long scenarios affordable; trips then come up to a pass late."""
    lengths_s = [phase.for_s or math.inf for phase in scenario.phases if phase.load not in ("acceleration", "skid-pad")]
    longest_s = 0.0 if scenario.loop else max(lengths_s, default=0.0)
    step = FINER_STEP_S.get(scenario.name, 1.0) if longest_s > 500 else 0.1
    is_coarse = scenario.name not in NEVER_COARSE and all(phase.load != "charge" for phase in scenario.phases)
    return step * (COARSE if is_coarse else 1.0)


@functools.lru_cache
def played_once(name: str) -> Played:
    """Return a scenario of the library that has been played to its end."""
    return Played(find_scenario(name))


SCENARIOS = [pytest.param(each.name, marks=in_the_campaign if each.name in LONG else ()) for each in library()[0]]


@pytest.mark.parametrize("name", SCENARIOS)
def test_what_the_file_expects_happens_and_no_other_trip(name):
    played = played_once(name)
    scenario = played.player.scenario
    slack_s = step_s(scenario)
    unexpected = [(at_s, event) for at_s, event in played.events if EventCode(event.code).name.startswith("TRIP_")]
    for item in scenario.expected:
        matching = [
            (at_s, event)
            for at_s, event in played.happened(item.event)
            if item.after_s <= at_s <= item.before_s + slack_s
            and item.cell in (None, event.cell)
            and item.value in (None, event.value)
        ]
        assert matching, f"{item} did not happen; there were {played.events}"
        unexpected = [pair for pair in unexpected if pair not in matching]
    assert unexpected == []
    assert list(played.player.notices) == []
    if any(phase.load == "charge" for phase in scenario.phases):
        limit_v = Config.from_image(played.simulation.master.image).v_cell_chrg * 1e-4
        assert played.highest_v < limit_v + 2e-3


@pytest.mark.parametrize("name", ["charging", pytest.param("charging-cold", marks=in_the_campaign)])
def test_charging_goes_through_its_states_once(name):
    played = played_once(name)
    states = [ChargingState(event.value) for _, event in played.happened(EventCode.CHARGER_STATE)]
    assert states == [
        ChargingState.WAITING,
        ChargingState.CONSTANT_CURRENT,
        ChargingState.BALANCING,
        ChargingState.CONSTANT_VOLTAGE,
        ChargingState.DONE,
    ]
    accumulator = played.simulation.accumulator
    assert accumulator.soc.min() > 0.9


@pytest.mark.parametrize(
    ("name", "start_soc", "until_s"),
    [("charging", 0.952, 300.0), pytest.param("charging-cold", 0.925, 240.0, marks=in_the_campaign)],
)
def test_at_the_master_s_own_pass_no_cell_is_overcharged(name, start_soc, until_s):
    """The minutes in which the first cell reaches its limit, and those in which the current comes back."""
    scenario = find_scenario(name)
    full = replace(scenario, start=replace(scenario.start, soc=start_soc), expected=())
    played = Played(full, pass_s=PASS_S, until_s=until_s)
    states = [ChargingState(event.value) for _, event in played.happened(EventCode.CHARGER_STATE)]
    assert ChargingState.CONSTANT_VOLTAGE in states
    limit_v = Config.from_image(played.simulation.master.image).v_cell_chrg * 1e-4
    assert limit_v - 2e-3 < played.highest_v < limit_v + 2e-3


def test_a_drifting_current_sensor_shows_in_the_count_and_not_in_the_cells():
    played = played_once("drifting-sensor")
    memory, accumulator = MasterMemory(played.simulation.master.image), played.simulation.accumulator
    counted_soc = FIELDS["soc"].unpack(memory.image)[0] * 1e-4
    missed_soc = 3.0 * 595.0 / 3600.0 / accumulator.capacity_ah.mean()
    assert counted_soc - accumulator.soc.mean() == pytest.approx(missed_soc, abs=0.6 * missed_soc)
    assert played.simulation.master.is_ok


@in_the_campaign
def test_unbalanced_cells_are_brought_together():
    played = played_once("charging-unbalanced")
    accumulator = played.simulation.accumulator
    at_start = ScenarioPlayer(played.player.scenario).simulation.accumulator.soc
    assert at_start.max() - at_start.min() > 0.015
    assert accumulator.soc.max() - accumulator.soc.min() < 0.75 * (at_start.max() - at_start.min())


def test_endurance_ends_where_a_real_one_would():
    played = played_once("clean-endurance")
    accumulator = played.simulation.accumulator
    assert 0.18 < accumulator.soc.mean() < 0.40
    assert 1400 < played.simulation.now_s < 1900
    assert MasterMemory(played.simulation.master.image).flags & 1


def test_loose_bolt_shows_under_load_and_not_at_rest():
    scenario = find_scenario("loose-bolt")
    player = ScenarioPlayer(scenario, step_s=0.1)
    sag_v = []

    def watch(at_s: float) -> None:
        accumulator = player.simulation.accumulator
        if 70 < at_s < 170 and player.simulation.current_a > 100:
            sag_v.append(accumulator.terminal_voltage_v.mean() - accumulator.terminal_voltage_v[30])

    step = player.simulation.before_step
    player.simulation.before_step = lambda at_s: (watch(at_s), step(at_s))
    player.run(175)
    assert min(sag_v) > 0.09  # 1 mohm at 100 A and more


def test_a_car_whose_precharge_failed_drives_only_after_it_was_mended_and_cleared():
    player = ScenarioPlayer(find_scenario("failed-precharge"))
    simulation = player.simulation
    player.run(19.5)
    assert simulation.master.has_precharge_failed
    assert (simulation.current_a, simulation.link.voltage_v) == (0.0, 0.0)
    assert MasterMemory(simulation.master.image).flags & (FLAG["fit"] | FLAG["load"]) == FLAG["fit"]
    player.run(3.0)
    assert simulation.current_a == 20.0
    assert simulation.link.voltage_v > 300.0


def test_damaged_frames_of_a_noisy_cable_are_all_found():
    played = Played(find_scenario("noisy-cable"), listen=True)
    steps = [(b - a) & 0xFF for a, b in zip(played.sequences, played.sequences[1:], strict=False)]
    lost = sum(step - 1 for step in steps if step)
    assert played.bad > 50
    assert lost > 50
    assert 0 not in steps
    assert played.happened(EventCode.BOOT)[0][1].value == 0


def test_brown_out_mid_write_leaves_old_or_new():
    for seed in range(4):
        scenario = find_scenario("brown-out-mid-write")
        player = ScenarioPlayer(scenario, seed=seed)
        player.run(30.0)
        master = player.simulation.master
        assert bytes(master.image[:CONFIG_SIZE]) == scenario.config
        assert newest(bytes(player.simulation.board.eeprom.content)).counter in (1, 2)


def test_a_worn_eeprom_refuses_and_keeps_the_old():
    replies = []
    player = ScenarioPlayer(find_scenario("worn-eeprom"))
    decoder = FrameDecoder()
    player.simulation.serial_out = lambda data: replies.extend(
        decode_message(frame).result for frame in decoder.feed(data) if frame.type == MessageType.REPLY
    )
    player.run(30.0)
    assert replies == [Result.EEPROM_FAILED]
    assert newest(bytes(player.simulation.board.eeprom.content)) is None
