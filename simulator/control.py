"""What a running simulation can be asked over its control port: state, faults, speed. No socket here."""

from collections.abc import Callable, Mapping
from typing import Any

from firmware_protocol.memory_map import CELLS_PER_PACK
from simulator.director import Director
from simulator.errors import FaultError, SimulatorError
from simulator.fault_kinds import FAULTS, Target
from simulator.faults import ActiveFault, cell_index
from simulator.library import library
from simulator.master import VirtualMaster
from simulator.relays import RelayState
from simulator.runner import MIN_SPEED, Runner

MAX_SPEED = 1000.0  # what a page may ask for


class Control:
    """What the requests do."""

    def __init__(self, director: Director, runner: Runner) -> None:
        self._director = director
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
        action = actions.get(str(request.get("do")))
        if action is None:
            return refusal(f"`do` is one of {', '.join(actions)}")
        try:
            return {"ok": True, **action(request)}
        except SimulatorError as error:
            return refusal(str(error))

    def _status(self, _: Mapping[str, Any]) -> dict[str, Any]:
        simulation = self._director.simulation
        return {
            "time_s": round(simulation.now_s, 3),
            "speed": self._runner.speed,
            "scenario": self._director.scenario.name,
            "phase": self._director.phase.load,
            "lap": simulation.load.state(simulation.load_time_s).lap,
            "soc": round(float(simulation.accumulator.soc.mean()), 5),
            "current_a": round(simulation.current_a, 2),
            "master_is_running": simulation.master is not None,
            "relays": _relays(simulation.master),
            "link_v": round(simulation.link.voltage_v, 1),
            "active": [_fault_json(fault) for fault in self._director.faults.active],
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
            ]
        }

    def _scenarios(self, _: Mapping[str, Any]) -> dict[str, Any]:
        scenarios, unreadable = library()
        return {
            "scenarios": [
                {"name": item.name, "title": item.title, "description": " ".join(item.description.split())}
                for item in scenarios
            ],
            "unreadable": [{"name": file.name, "reason": file.reason} for file in unreadable],
        }

    def _inject(self, request: Mapping[str, Any]) -> dict[str, Any]:
        name = str(request.get("fault"))
        self._director.faults.inject(name, _target(name, request), _number(request, "value"), _number(request, "for_s"))
        return {}

    def _clear(self, request: Mapping[str, Any]) -> dict[str, Any]:
        name = str(request.get("fault"))
        self._director.faults.clear(name, _target(name, request))
        return {}

    def _clear_all(self, _: Mapping[str, Any]) -> dict[str, Any]:
        self._director.faults.clear_all()
        return {}

    def _speed(self, request: Mapping[str, Any]) -> dict[str, Any]:
        if request.get("value") == "max":
            self._runner.set_speed(None)
            return {}
        speed = _number(request, "value")
        if speed is None or not MIN_SPEED <= speed <= MAX_SPEED:
            raise FaultError("speed", f"give {MIN_SPEED:g} to {MAX_SPEED:g}, or `max`")
        self._runner.set_speed(speed)
        return {}

    def _next(self, _: Mapping[str, Any]) -> dict[str, Any]:
        self._director.next_phase()
        return {}

    def _unplug(self, request: Mapping[str, Any]) -> dict[str, Any]:
        for_s = _number(request, "for_s")
        if for_s is None or not 0 < for_s <= 3600:
            raise FaultError("unplug", "give for_s, the wall seconds without the RS232 cable")
        self._runner.unplug_serial(for_s)
        return {}


def _relays(master: VirtualMaster | None) -> str:
    if master is None:
        return RelayState.OPEN.value
    return "precharge failed" if master.has_precharge_failed else master.relay_state.value


def _target(name: str, request: Mapping[str, Any]) -> int:
    kind = FAULTS.get(name)
    if kind is None or kind.target is Target.NONE:
        return 0
    pack = _number(request, "pack")
    cell = _number(request, "cell") if kind.target is Target.CELL else 1
    if pack is None or cell is None or pack != int(pack) or cell != int(cell):
        raise FaultError(
            name, f"give the {'pack and the cell' if kind.target is Target.CELL else 'pack'} as people count"
        )
    index = cell_index(int(pack), int(cell))
    return index if kind.target is Target.CELL else index // CELLS_PER_PACK


def _number(request: Mapping[str, Any], key: str) -> float | None:
    value = request.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise FaultError(key, f"{value!r} is no number")
    return float(value)


def _fault_json(fault: ActiveFault) -> dict[str, Any]:
    out: dict[str, Any] = {"fault": fault.name, "value": fault.value, "since_s": round(fault.since_s, 3)}
    out["until_s"] = None if fault.until_s is None else round(fault.until_s, 3)
    match FAULTS[fault.name].target:
        case Target.CELL:
            out["pack"], out["cell"] = fault.target // CELLS_PER_PACK + 1, fault.target % CELLS_PER_PACK + 1
        case Target.PACK:
            out["pack"] = fault.target + 1
    return out


def refusal(error: str) -> dict[str, Any]:
    """Return the answer to a request that was not carried out."""
    return {"ok": False, "error": error}
