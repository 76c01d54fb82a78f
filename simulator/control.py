"""The requests that a running simulation takes over its control port: state, faults, speed. No socket here."""

from collections.abc import Callable, Mapping
from typing import Any

from simulator.bms_state import RelayState
from simulator.errors import SimulatorError
from simulator.fault_kinds import FAULTS, FaultKind, Target, read_fault
from simulator.faults import ActiveFault, read_target
from simulator.inputs import FOR_S, MIN_SPEED, NumberRange, read_number, read_optional, refuse_unknown
from simulator.library import library
from simulator.runner import Runner
from simulator.scenario_player import Notice, ScenarioPlayer
from simulator.shape import Shape
from simulator.vehicle import Operated

MAX_SPEED = 1000.0  # what a page may ask for
MAX_UNPLUGGED_S = 3600.0
_SPEED = NumberRange(MIN_SPEED, MAX_SPEED)
_UNPLUGGED = NumberRange(0, MAX_UNPLUGGED_S, "s", is_above=True)
_KEYS = {
    "status": (),
    "faults": (),
    "scenarios": (),
    "inject": ("fault", "pack", "cell", "value", "for_s"),
    "clear": ("fault", "pack", "cell"),
    "clear-all": (),
    "speed": ("value",),
    "next": (),
    "unplug": ("for_s",),
}


class Control:
    """Carries out the requests of the control port."""

    def __init__(self, player: ScenarioPlayer, runner: Runner) -> None:
        self._player = player
        self._runner = runner

    def answer(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Carry out a request and return the answer; `ok` says whether it was done."""
        actions: dict[str, Callable[[Mapping[str, Any]], dict[str, Any]]] = {
            "status": self._status,
            "faults": self._faults,
            "scenarios": self._scenarios,
            "inject": self._inject,
            "clear": self._clear,
            "clear-all": self._clear_all,
            "speed": self._speed,
            "next": self._next,
            "unplug": self._unplug,
        }
        do = request.get("do")
        if not isinstance(do, str) or do not in actions:
            return refusal(f"`do` is one of {', '.join(actions)}")
        given = {key: value for key, value in request.items() if value is not None}
        try:
            refuse_unknown(given, {"do", *_KEYS[do]}, f"to {do!r}")
            return {"ok": True, **actions[do](given)}
        except SimulatorError as error:
            return refusal(str(error))

    def _status(self, _: Mapping[str, Any]) -> dict[str, Any]:
        simulation = self._player.simulation
        return {
            "time_s": round(simulation.now_s, 3),
            "speed": self._runner.speed,
            "scenario": self._player.scenario.name,
            "phase": self._player.phase.load,
            "lap": simulation.load.state(simulation.load_time_s).lap,
            "soc": round(float(simulation.accumulator.soc.mean()), 5),
            "current_a": round(simulation.current_a, 2),
            "master_is_running": simulation.operated is not None,
            "relays": _relays(simulation.operated),
            "relays_since_s": None if simulation.operated is None else round(simulation.operated.relays_since_s, 3),
            "link_v": round(simulation.link.voltage_v, 1),
            "notices": [_notice_json(notice) for notice in self._player.notices],
            "active": [_fault_json(fault, simulation.shape) for fault in self._player.faults.active],
        }

    def _faults(self, _: Mapping[str, Any]) -> dict[str, Any]:
        return {
            "faults": [
                {
                    "fault": kind.name,
                    "meaning": kind.meaning,
                    "area": kind.area,
                    "target": kind.target.value,
                    "unit": kind.unit,
                    "minimum": kind.minimum,
                    "maximum": kind.maximum,
                    "default": kind.default,
                    "is_instant": kind.is_instant,
                }
                for kind in FAULTS.values()
                if self._player.simulation.shape.is_team or not kind.is_of_team
            ]
        }

    def _scenarios(self, _: Mapping[str, Any]) -> dict[str, Any]:
        scenarios, unreadable = library(shape=self._player.simulation.shape)
        return {
            "scenarios": [
                {"name": item.name, "title": item.title, "description": " ".join(item.description.split())}
                for item in scenarios
            ],
            "unreadable": [{"name": file.name, "reason": file.reason} for file in unreadable],
        }

    def _inject(self, request: Mapping[str, Any]) -> dict[str, Any]:
        kind = _kind(request)
        value, for_s = request.get("value"), read_optional(request, "for_s", FOR_S)
        self._player.faults.inject(kind.name, self._target(kind, request), value, for_s)
        return {"fault": kind.name}

    def _clear(self, request: Mapping[str, Any]) -> dict[str, Any]:
        kind = _kind(request)
        self._player.faults.clear(kind.name, self._target(kind, request))
        return {}

    def _target(self, kind: FaultKind, request: Mapping[str, Any]) -> int:
        return read_target(kind.target, request, self._player.simulation.shape)

    def _clear_all(self, _: Mapping[str, Any]) -> dict[str, Any]:
        self._player.faults.clear_all()
        return {}

    def _speed(self, request: Mapping[str, Any]) -> dict[str, Any]:
        if request.get("value") == "max":
            self._runner.set_speed(None)
            return {}
        self._runner.set_speed(read_number(request, "value", _SPEED))
        return {}

    def _next(self, _: Mapping[str, Any]) -> dict[str, Any]:
        self._player.next_phase()
        return {}

    def _unplug(self, request: Mapping[str, Any]) -> dict[str, Any]:
        self._runner.unplug_serial(read_number(request, "for_s", _UNPLUGGED))
        return {}


def _kind(request: Mapping[str, Any]) -> FaultKind:
    return read_fault(request, "fault")


def _relays(bms: Operated | None) -> str:
    if bms is None:
        return RelayState.OPEN.value
    return "precharge failed" if bms.has_precharge_failed else bms.relay_state.value


def _notice_json(notice: Notice) -> dict[str, Any]:
    args = {"action": notice.action, "planned_s": notice.planned_s}
    return {"at_s": round(notice.at_s, 3), "message": {"code": notice.code, "args": args, "text": notice.text}}


def _fault_json(fault: ActiveFault, shape: Shape) -> dict[str, Any]:
    out: dict[str, Any] = {"fault": fault.name, "value": fault.value, "since_s": round(fault.since_s, 3)}
    out["until_s"] = None if fault.until_s is None else round(fault.until_s, 3)
    match FAULTS[fault.name].target:
        case Target.CELL:
            out["pack"], out["cell"] = shape.place(fault.target)
        case Target.PACK:
            out["pack"] = fault.target + 1
    return out


def refusal(error: str) -> dict[str, Any]:
    """Return the answer to a request that was not carried out."""
    return {"ok": False, "error": error}
