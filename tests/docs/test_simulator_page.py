"""docs/reference/simulator.md names every fault, load and action that the simulator knows."""

from pathlib import Path

from simulator.control import Control
from simulator.fault_kinds import FAULTS, FaultKind
from simulator.library import find_scenario
from simulator.runner import Runner
from simulator.scenario import ACTIONS, LOADS
from simulator.scenario_player import ScenarioPlayer

PAGE = (Path(__file__).parents[2] / "docs" / "reference" / "simulator.md").read_text(encoding="utf-8")


def row(kind: FaultKind) -> str:
    values = "" if kind.minimum == kind.maximum else f"{kind.minimum:g}..{kind.maximum:g} {kind.unit}".strip()
    default = f" ({kind.default:g})" if values else ""
    return f"| `{kind.name}` | {kind.target.value} | {values}{default} | {kind.meaning} |"


def test_table_of_faults_is_current():
    table = PAGE.partition("<!-- faults -->\n")[2].partition("<!-- end -->")[0]
    head = "| fault | target | value (default) | meaning |\n| --- | --- | --- | --- |\n"
    assert table == head + "".join(f"{row(kind)}\n" for kind in FAULTS.values())


def test_loads_and_actions_are_named():
    assert [name for name in (*LOADS, *ACTIONS) if f"`{name}`" not in PAGE] == []


def test_control_requests_are_named():
    player = ScenarioPlayer(find_scenario("skid-pad"))
    refusal = Control(player, Runner(player.simulation)).answer({})["error"]
    names = refusal.removeprefix("`do` is one of ").split(", ")
    assert [name for name in names if f"| `{name}` |" not in PAGE] == []
