"""Test benches that cause a fault: the simulator by itself, or a person who pulls the plug."""

from collections.abc import Callable
from dataclasses import asdict
from typing import Any, Final, Protocol

from app.analysis.evidence.steps import Sign, Step
from app.analysis.evidence.timing import ConfiguredLimits
from firmware_protocol.memory_map import CONFIG

SCENARIO: Final = """\
title = "Reaction test"
description = "Standing, relays closed, a steady current: faults come over the control port."
seed = 58
[start]
soc = 0.8
[[phase]]
load = "constant"
current_a = 20
for_s = 100000
"""
PACK, CELL = 3, 7
_BEYOND_A, _BEYOND_K = 400.0, 20
_OVER_V, _UNDER_V = 5.0, 1.0  # so far that the filter needs a pass or two
_FAULTS: Final[dict[Sign, tuple[str, str, str]]] = {  # fault of the simulator; what a person does, and undoes
    "voltage-high": (
        "cell-voltage-stuck",
        "Raise the measured voltage of one cell above {v_cell_max} V (a supply at one cell input)",
        "Put the cell's voltage back",
    ),
    "voltage-low": (
        "cell-voltage-stuck",
        "Lower the measured voltage of one cell below {v_cell_min} V, not to nothing",
        "Put the cell's voltage back",
    ),
    "current-high": (
        "current-sensor-offset",
        "Drive more than {i_disc_max} A through the current sensor (a wire wound through it counts each turn)",
        "Switch that current off",
    ),
    "current-low": (
        "current-sensor-offset",
        "Drive more than {i_disc_min} A backwards through the current sensor",
        "Switch that current off",
    ),
    "temperature-high": (
        "temperature-sensor-fault",
        "Make one temperature sensor show more than {t_cell_max} degC (a resistor in its place)",
        "Connect the sensor again",
    ),
    "temperature-low": (
        "temperature-sensor-fault",
        "Make one temperature sensor show less than {t_cell_min} degC (a resistor in its place)",
        "Connect the sensor again",
    ),
    "slave-lost": ("slave-lost", "Pull the plug of slave {pack}", "Plug it in again"),
    "wire-lost": ("sense-wire-open", "Disconnect one cell wire", "Connect it again"),
    "temperature-lost": ("temperature-sensor-open", "Disconnect one temperature sensor", "Connect it again"),
    "current-lost": ("current-sensor-open", "Disconnect the current sensor", "Connect it again"),
}


class Skipped(Exception):
    """A step that is not done, and why."""


class Bench(Protocol):
    """Makes faults and takes them away."""

    def fail(self, step: Step, limits: ConfiguredLimits) -> None:
        """Make the fault; Skipped where it is not done."""

    def repair(self, step: Step) -> None:
        """Take it away, so that faults can be cleared."""


class SimulatedBench:
    """The simulator, asked over its control port."""

    def __init__(self, ask: Callable[[str, dict[str, Any]], object]) -> None:
        self._ask = ask

    def fail(self, step: Step, limits: ConfiguredLimits) -> None:
        """Inject the fault."""
        value = {
            "voltage-high": _OVER_V,
            "voltage-low": _UNDER_V,
            "current-high": _BEYOND_A,
            "current-low": -_BEYOND_A,
            "temperature-high": limits.t_cell_max + _BEYOND_K,
            "temperature-low": limits.t_cell_min - _BEYOND_K,
        }.get(step.name)
        self._ask("inject", {"fault": _FAULTS[step.name][0], "value": value, **self._place(step)})

    def repair(self, step: Step) -> None:
        """Clear it."""
        self._ask("clear", {"fault": _FAULTS[step.name][0], **self._place(step)})

    def _place(self, step: Step) -> dict[str, int]:
        if step.name.startswith("current"):
            return {}
        return {"pack": PACK} if step.name == "slave-lost" else {"pack": PACK, "cell": CELL}


class ManualBench:
    """Asks a person on the console."""

    def fail(self, step: Step, limits: ConfiguredLimits) -> None:
        """Prompt; an answer other than nothing is why the step is skipped."""
        numbers = {name: f"{value * CONFIG[name].scale:g}" for name, value in asdict(limits).items()}
        what = _FAULTS[step.name][1].format(**numbers, pack=PACK)
        if reason := input(f"  {what} now, then press Enter (or type why this step is skipped): ").strip():
            raise Skipped(reason)

    def repair(self, step: Step) -> None:
        """Prompt."""
        input(f"  {_FAULTS[step.name][2]}, reset the shutdown circuit, then press Enter: ")
