"""Plays a scenario on a simulation: its start, its phases one after the other, its faults and its operator.

A looping scenario starts again after its last phase, its faults and actions included; what state the accumulator is in,
and faults that are for good, stay as they are.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from firmware_protocol.eeprom import plan_store
from firmware_protocol.messages import CommandId
from simulator.accumulator import AccumulatorParameters
from simulator.ageing import Ageing, aged
from simulator.bms_state import ChargingState
from simulator.dbc_battery.battery import DbcBattery
from simulator.dbc_battery.simulation import BatterySimulation
from simulator.eeprom import Eeprom
from simulator.errors import InputError
from simulator.faults import FaultBoard
from simulator.loads import ConstantCurrent, Idle, Load, Pattern, Recorded, Rest
from simulator.race import acceleration, endurance, skid_pad
from simulator.scenario import ActionPlan, FaultPlan, PhasePlan, Scenario
from simulator.shape import TEAM
from simulator.simulation import Simulation
from simulator.vehicle import PASS_S, SOC_SCALE, Vehicle

CHARGE_RETRY_S = 1.0
STANDBY_S = 2.0  # from high voltage on to driving
MAX_NOTICES = 20
_COMMANDS = {
    "charge-start": CommandId.CHARGE_START,
    "charge-stop": CommandId.CHARGE_STOP,
    "balance-start": CommandId.BALANCE_START,
    "balance-stop": CommandId.BALANCE_STOP,
    "clear-faults": CommandId.CLEAR_FAULTS,
    "soc": CommandId.SET_SOC,
    "reset": CommandId.RESET,
}


NOTICES = {  # in English; a reader in another language translates by the code
    "action-master-off": "{action} not executed: the master is off",
    "action-refused": "{action} rejected by the master in its present state",
    "action-never-came": "{action} at {planned_s} s not executed: the phases ended before",
}


@dataclass(frozen=True, slots=True)
class Notice:
    """A part of the scenario that could not be carried out."""

    at_s: float
    code: str
    action: str
    planned_s: float

    @property
    def text(self) -> str:
        """Return what did not happen, and why."""
        return NOTICES[self.code].format(action=self.action, planned_s=f"{self.planned_s:g}")

    def __str__(self) -> str:
        return f"at {self.at_s:g} s: {self.text}"


class ScenarioPlayer:
    """A scenario being played."""

    def __init__(
        self,
        scenario: Scenario,
        *,
        eeprom: Eeprom | None = None,
        seed: int | None = None,
        step_s: float = PASS_S,
        battery: DbcBattery | None = None,
    ) -> None:
        """Build the simulation that the scenario starts with: without a battery the team's own car."""
        self.scenario = scenario
        used_seed = scenario.seed if seed is None else seed
        self.simulation: Vehicle
        if battery is None:
            self.simulation = _of_team(scenario, eeprom or Eeprom(), used_seed, step_s)
        else:
            parameters = _parameters(scenario, battery.shape.n_cells, used_seed)
            self.simulation = BatterySimulation(parameters, battery, seed=used_seed, step_s=step_s)
        self.simulation.accumulator.sun_w = scenario.start.sun_w
        self.faults = FaultBoard(self.simulation)
        start, accumulator = scenario.start, self.simulation.accumulator
        self._ageing = Ageing(start, accumulator, used_seed) if start.ageing > 0.0 else None
        self._loads_rng = np.random.default_rng(used_seed + 1)
        self.notices: deque[Notice] = deque(maxlen=MAX_NOTICES)
        self.on_notice: Callable[[Notice], None] | None = None
        self._timeline: deque[FaultPlan | ActionPlan] = deque()
        self._round_start_s = 0.0
        self._phase_index = -1
        self._phase_start_s = 0.0
        self._charge_retry_s = 0.0
        self._has_charged = False
        self.is_over = False
        self.next_phase()
        self.simulation.before_step = self._step

    @property
    def phase(self) -> PhasePlan:
        """The current phase of the scenario."""
        return self.scenario.phases[self._phase_index]

    def run(self, for_s: float) -> None:
        """Run for this virtual time, or to the end of the scenario [s]."""
        end_s = self.simulation.now_s + for_s
        while not self.is_over and self.simulation.now_s < end_s:
            self.simulation.run_until(min(self.simulation.now_s + 1.0, end_s))

    def _step(self, now_s: float) -> None:
        self.faults.step(now_s)
        if self._ageing is not None:
            self._ageing.step(now_s)
        while self._timeline and self._timeline[0].at_s <= now_s - self._round_start_s:
            self._play(self._timeline.popleft())
        plan = self.phase
        if plan.load == "charge":
            self._charge(now_s)
        self._follow_ambient()
        if not self.is_over and self._is_over(plan, now_s):
            self.next_phase()

    def _follow_ambient(self) -> None:
        """Set the air to the temperature of a recording, unless a fault sets it."""
        load = self.simulation.load
        if not isinstance(load, Recorded):
            return
        if not any(fault.name == "ambient-temperature" for fault in self.faults.active):
            degc = load.ambient_at_degc(self.simulation.load_time_s)
            if degc is not None:
                self.simulation.set_ambient(degc)

    def _play(self, plan: FaultPlan | ActionPlan) -> None:
        if isinstance(plan, FaultPlan):
            self.faults.inject(plan.name, plan.target, plan.value, plan.for_s)
        elif self.simulation.operated is None:
            self._notice("action-master-off", plan)
        elif not self._act(plan):
            self._notice("action-refused", plan)

    def _act(self, plan: ActionPlan) -> bool:
        if plan.name == "store":
            bms = self.simulation.operated
            return bms is not None and bms.store_config(self.simulation.now_s)
        return self._command(_COMMANDS[plan.name], round((plan.argument or 0.0) * SOC_SCALE))

    def _notice(self, code: str, plan: FaultPlan | ActionPlan) -> None:
        notice = Notice(self.simulation.now_s, code, str(plan), plan.at_s)
        self.notices.append(notice)
        if self.on_notice is not None:
            self.on_notice(notice)

    def _command(self, command: CommandId, argument: int = 0) -> bool:
        bms = self.simulation.operated
        return bms is not None and bms.command(command, argument, self.simulation.now_s)

    def _charge(self, now_s: float) -> None:
        bms = self.simulation.operated
        if bms is None or self._has_charged or now_s < self._charge_retry_s:
            return
        self._charge_retry_s = now_s + CHARGE_RETRY_S
        self._has_charged = bms.charging.is_active or self._command(CommandId.CHARGE_START)

    def _is_over(self, plan: PhasePlan, now_s: float) -> bool:
        elapsed_s = now_s - self._phase_start_s
        if plan.for_s is not None and elapsed_s >= plan.for_s:
            return True
        if plan.until_soc is not None:
            left = float(self.simulation.accumulator.soc.mean()) - plan.until_soc
            if (left >= 0.0) if plan.is_filling else (left <= 0.0):
                return True
        if plan.load == "charge":
            bms = self.simulation.operated
            ended = (ChargingState.DONE, ChargingState.FAULT)
            return self._has_charged and bms is not None and bms.charging.state in ended
        return elapsed_s >= self.simulation.load.duration_s

    def next_phase(self) -> None:
        """Go to the next phase, or end the scenario.

        Raises:
            InputError: the scenario is over.
        """
        if self.is_over:
            raise InputError("next", "the scenario is over")
        bms = self.simulation.operated
        if bms is not None and bms.charging.is_active:
            self._command(CommandId.CHARGE_STOP)
        self._phase_index += 1
        if self._phase_index == len(self.scenario.phases):
            self._end_round()
            if self.is_over:
                return
        if self._phase_index == 0:
            self._round_start_s = self.simulation.now_s
            plans: list[FaultPlan | ActionPlan] = [*self.scenario.faults, *self.scenario.actions]
            self._timeline.extend(sorted(plans, key=lambda plan: plan.at_s))
        self._phase_start_s = self.simulation.now_s
        self._has_charged = False
        self._charge_retry_s = 0.0
        plan = self.phase
        self.simulation.charger.is_plugged = plan.load in ("charge", "charge-by-hand")
        self.simulation.set_load(self._load(plan))

    def _end_round(self) -> None:
        for plan in self._timeline:
            self._notice("action-never-came", plan)
        self._timeline.clear()
        if self.scenario.loop:
            self._phase_index = 0
            return
        self._phase_index -= 1
        self.is_over = True
        self.simulation.set_load(Rest())

    def _load(self, plan: PhasePlan) -> Load:
        match plan.load:
            case "idle":
                return Idle()
            case "constant":
                return ConstantCurrent(plan.current_a)
            case "endurance":
                return endurance(self._loads_rng, n_laps=plan.laps, standby_s=STANDBY_S)
            case "acceleration":
                return acceleration()
            case "skid-pad":
                return skid_pad()
            case "pattern":
                capacity_ah = float(self.simulation.accumulator.capacity_ah.mean())
                return Pattern(plan.pattern_c, capacity_ah, scale=plan.power_scale)
        return plan.recording or Rest()


def _of_team(scenario: Scenario, eeprom: Eeprom, seed: int, step_s: float) -> Simulation:
    if scenario.config is not None:
        for page in plan_store(bytes(eeprom.content), scenario.config):
            eeprom.write(page.offset, page.data)
    parameters = _parameters(scenario, TEAM.n_cells, seed)
    return Simulation(
        parameters,
        eeprom=eeprom,
        seed=seed,
        step_s=step_s,
        balancing=scenario.balancing,
        sensor_inputs=scenario.sensor_inputs,
    )


def _parameters(scenario: Scenario, n_cells: int, seed: int) -> AccumulatorParameters:
    start = scenario.start
    soc = np.full(n_cells, start.soc)
    for cell, cell_soc in start.cells.items():
        soc[int(cell)] = cell_soc
    capacity, resistance = aged(start, n_cells, seed)
    return AccumulatorParameters(
        n_cells=n_cells,
        start_soc=soc,
        start_soc_spread=start.soc_spread,
        ambient_degc=start.ambient_degc,
        capacity_spread=start.capacity_spread,
        resistance_spread=start.resistance_spread,
        capacity_ageing=capacity,
        resistance_ageing=resistance,
    )
