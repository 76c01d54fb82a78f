"""A scenario as it is played: its rounds, the ends of its phases, and what it could not do."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from firmware_protocol.framing import Frame, FrameDecoder
from firmware_protocol.messages import EventCode, EventMessage, MessageType, decode_message
from simulator.scenario_file import load_scenario
from simulator.scenario_player import ScenarioPlayer
from tests.master_memory import MasterMemory

HEAD = 'title = "t"\ndescription = "d"\nseed = 3\n'


class Played:
    """A scenario and the events that its master told, with their times."""

    def __init__(self, path: Path, text: str) -> None:
        path.write_text(HEAD + text)
        self.player = ScenarioPlayer(load_scenario(path), step_s=0.1)
        self.events: list[tuple[float, EventMessage]] = []
        self._decoder = FrameDecoder()
        self.player.simulation.serial_out = self._take

    def _take(self, data: bytes) -> None:
        for item in self._decoder.feed(data):
            if isinstance(item, Frame) and item.type == MessageType.EVENT:
                self.events.append((self.player.simulation.now_s, decode_message(item)))

    def happened(self, code: EventCode) -> list[tuple[float, int]]:
        return [(at_s, event.value) for at_s, event in self.events if event.code == code]

    @property
    def notices(self) -> list[str]:
        return [str(notice) for notice in self.player.notices]


@pytest.fixture
def play(tmp_path: Path) -> Callable[[str], Played]:
    return lambda text: Played(tmp_path / "mine.toml", text)


def phase(load: str, **keys: float) -> str:
    return "".join(["[[phase]]\n", f'load = "{load}"\n', *(f"{key} = {value}\n" for key, value in keys.items())])


def action(at_s: float, name: str, **keys: float) -> str:
    return "".join(
        ["[[action]]\n", f'at_s = {at_s}\nname = "{name}"\n', *(f"{key} = {value}\n" for key, value in keys.items())]
    )


@pytest.mark.parametrize("inputs", [None, [*range(1, 13)], [12, *range(1, 12)]])
def test_every_cell_has_its_own_temperature_however_its_sensor_is_wired(play, inputs):
    """One sensor is off: in the struct its cell is without a temperature, whatever input the chip reads it by."""
    slaves = "" if inputs is None else f"[slaves]\nsensor_inputs = {inputs}\n"
    fault = '[[fault]]\nat_s = 0.5\nname = "temperature-sensor-open"\npack = 2\ncell = 5\n'
    played = play(slaves + phase("rest", for_s=9) + fault)
    played.player.run(2)
    memory = MasterMemory(played.player.simulation.master.image)
    assert np.flatnonzero(memory.t == -128).tolist() == [16]
    at = (0, 2, 4, 6, 8, 10, 1, 3, 5, 7, 9, 11)[4] if inputs is None else inputs[4] - 1
    assert np.flatnonzero(memory.slave_temp[1] == 0).tolist() == [at + 12 * (at % 2)]


def test_each_round_has_its_faults_and_actions(play):
    fault = '[[fault]]\nat_s = 5\nname = "cooling-failed"\nfor_s = 2\n'
    played = play(
        "loop = true\n" + phase("rest", for_s=12) + phase("rest", for_s=8) + fault + action(8, "soc", argument=0.4)
    )
    blocked = []
    for second in range(60):
        played.player.run(second + 0.5 - played.player.simulation.now_s)
        blocked += [second] if played.player.faults.active else []
    assert blocked == [5, 6, 25, 26, 45, 46]
    told = played.happened(EventCode.SOC_SET)
    assert [at_s for at_s, _ in told] == pytest.approx([8, 28, 48], abs=0.5)
    assert {value for _, value in told} == {4000}
    assert played.notices == []


def test_a_fault_for_good_stays_over_the_rounds(play):
    fault = '[[fault]]\nat_s = 1\nname = "joint-resistance-high"\npack = 1\ncell = 2\n'
    played = play("loop = true\n" + phase("rest", for_s=3) + fault)
    played.player.run(3.5)
    assert [active.since_s for active in played.player.faults.active] == pytest.approx([1.0])
    played.player.run(1.0)
    assert [active.since_s for active in played.player.faults.active] == pytest.approx([4.0], abs=0.21)


def test_what_a_round_is_too_short_for_is_told(play):
    fault = '[[fault]]\nat_s = 7\nname = "slave-lost"\npack = 2\n'
    played = play(phase("rest", for_s=2) + fault + action(9, "soc", argument=0.5))
    played.player.run(10.0)
    assert played.player.is_over
    assert [text.partition(": ")[2] for text in played.notices] == [
        "slave-lost in pack 2 at 7 s not executed: the phases ended before",
        "soc 0.5 at 9 s not executed: the phases ended before",
    ]


@pytest.mark.parametrize("name", ["charge-start", "balance-start"])
def test_an_action_that_the_master_refuses_is_told(play, name):
    played = play(phase("idle", for_s=6) + action(4, name))
    played.player.run(5.0)
    assert played.notices == [f"at 4 s: {name} rejected by the master in its present state"]


def test_an_action_without_a_master_is_told(play):
    fault = '[[fault]]\nat_s = 1\nname = "master-supply-lost"\nvalue = 3\n'
    played = play(phase("rest", for_s=6) + fault + action(2, "store"))
    played.player.run(5.0)
    assert played.notices == ["at 2 s: store not executed: the master is off"]


def test_charging_ends_when_it_has_come_up_to_until_soc(play):
    played = play("[start]\nsoc = 0.5\nsoc_spread = 0.001\n" + phase("charge", until_soc=0.52))
    played.player.run(30.0)
    assert played.player.simulation.current_a < -1.0
    assert not played.player.is_over
    played.player.run(3600.0)
    assert played.player.is_over
    assert played.player.simulation.accumulator.soc.mean() == pytest.approx(0.52, abs=2e-4)


@pytest.mark.parametrize(("current_a", "until_soc"), [(-20, 0.51), (100, 0.49)])
def test_a_constant_current_ends_at_until_soc_from_its_side(play, current_a, until_soc):
    played = play("[start]\nsoc = 0.5\nsoc_spread = 0\n" + phase("constant", current_a=current_a, until_soc=until_soc))
    played.player.run(5.0)
    assert not played.player.is_over
    played.player.run(120.0)
    assert played.player.is_over
    assert played.player.simulation.accumulator.soc.mean() == pytest.approx(until_soc, abs=2e-4)


@pytest.mark.parametrize(("method", "gives_to_the_pack"), [("passive", False), ("transformer", True)])
def test_the_accumulator_balances_by_the_method_of_the_scenario(play, method, gives_to_the_pack):
    start = '[start]\nsoc = 0.6\nsoc_spread = 0\n[start.cells]\n"4/2" = 0.7\n'
    played = play(f'{start}[balancing]\nmethod = "{method}"\n' + phase("rest", for_s=90) + action(5, "balance-start"))
    accumulator = played.player.simulation.accumulator
    before = accumulator.soc.copy()
    played.player.run(60)
    moved = accumulator.soc - before
    assert moved[3 * 12 + 1] < -2e-5
    assert (moved[3 * 12 + 2] > 0.0) == gives_to_the_pack


@pytest.mark.parametrize("ageing", [0, 1_000_000])
def test_cells_age_while_a_scenario_is_played_where_it_says_so(tmp_path, ageing):
    text = f"[start]\nageing = {ageing}\n[[phase]]\nload = 'rest'\nfor_s = 70\n"
    player = Played(tmp_path / "aged.toml", text).player
    new = player.simulation.accumulator.capacity_ah.copy()
    player.run(66.0)
    assert ((player.simulation.accumulator.capacity_ah < new) == bool(ageing)).all()
