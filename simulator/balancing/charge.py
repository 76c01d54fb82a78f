"""A charge or a rest with a balancer, from start to end. A charge: constant current, then constant highest voltage."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from simulator.accumulator import Accumulator
from simulator.balancing.balancers import Balancer
from simulator.balancing.circuits import Balance
from simulator.cell_data import FloatArray
from simulator.errors import ParameterError

SECONDS_PER_HOUR = 3600.0
SAMPLE_S = 60.0  # period of the traces
PARTS = 1000  # steps of a charge's or a rest's progress
OnProgress = Callable[[int, int], None]  # parts done, parts in all


@dataclass(frozen=True)
class Supervisor:
    """Stops everything outside the safe operating area."""

    max_v: float = 4.2
    min_v: float = 2.5
    max_degc: float = 40.0
    min_degc: float = 0.0

    def objection(self, accumulator: Accumulator) -> str | None:
        """Return what is outside the limits, None if nothing is."""
        voltage_v, temperature_degc = accumulator.terminal_voltage_v, accumulator.temperature_degc
        if voltage_v.max() >= self.max_v:
            return "over-voltage"
        if voltage_v.min() <= self.min_v:
            return "under-voltage"
        if temperature_degc.max() >= self.max_degc:
            return "over-temperature"
        if temperature_degc.min() <= self.min_degc:
            return "under-temperature"
        return None


@dataclass(frozen=True)
class ChargePlan:
    """Constant current until the highest cell reaches `top_v`, then that voltage until the current is below `end_a`."""

    current_a: float  # charging counts positive here
    top_v: float = 4.1895
    end_a: float = 0.03
    loop_ohm: float = 0.025  # what the regulator takes a cell's resistance for; twice the real one never overshoots
    control_period_s: float = 1.0  # period of supervisor, balancer and regulator
    dt_s: float = 1.0  # step of the physics in between
    time_limit_s: float = 24 * SECONDS_PER_HOUR

    def __post_init__(self) -> None:
        if not self.current_a > self.end_a > 0.0:
            raise ParameterError("current_a, end_a", (self.current_a, self.end_a), "current above end current above 0")

    def next_current_a(self, current_a: float, highest_v: float) -> float:
        """Return the charging current of the next step, from that of the last and the voltage it led to.

        One law for both phases, min(I_cc, I + (V_top - V) / R): no switch between them that could chatter.
        """
        return min(self.current_a, max(0.0, current_a + (self.top_v - highest_v) / self.loop_ohm))


@dataclass
class BalancingRun:
    """Result of a charge or a rest. Traces have one entry a minute and one at the end."""

    hours: float
    max_degc: float  # temperature of the hottest cell
    max_board_degc: float  # temperature of the hottest slave board
    soc_difference: float  # highest less lowest at the end
    highest_soc: float
    highest_v: float
    stopped_by: str | None  # the supervisor's word, "time" at the limit, None where it ended as planned
    charger_wh: float
    balancing_loss_wh: float
    lost_soc: float  # mean SOC given up; negative by what was charged
    time_h: FloatArray
    soc: FloatArray  # (samples, n)
    voltage_v: FloatArray
    temperature_degc: FloatArray
    current_a: FloatArray  # current of the charger, positive


def charge(
    accumulator: Accumulator,
    balancer: Balancer,
    plan: ChargePlan,
    supervisor: Supervisor | None = None,
    on_progress: OnProgress = lambda done, of: None,
) -> BalancingRun:
    """Charge until the plan's end, the supervisor's objection, or the time limit; the accumulator is left there."""
    supervisor = supervisor or Supervisor()
    steps = max(1, round(plan.control_period_s / plan.dt_s))
    empty = 1.0 - float(accumulator.soc.mean())
    log = _Log(accumulator, steps * plan.dt_s, on_progress, plan.time_limit_s)
    current_a, stopped_by = plan.current_a, None
    for _ in range(round(plan.time_limit_s / log.period_s)):
        stopped_by = supervisor.objection(accumulator)
        if stopped_by is not None:
            break
        current_a = plan.next_current_a(current_a, float(accumulator.terminal_voltage_v.max()))
        log.sample(current_a, 1.0 - (1.0 - float(accumulator.soc.mean())) / max(empty, 1e-9))
        if current_a < plan.end_a:
            break
        log.step(balancer.decide(accumulator, log.period_s), current_a, steps)
    else:
        stopped_by = "time"
    return log.finished(current_a, stopped_by)


def equalise(
    accumulator: Accumulator,
    balancer: Balancer,
    *,
    difference: float,
    period_s: float = 10.0,
    fan_duty: float = 0.0,
    time_limit_s: float = 48 * SECONDS_PER_HOUR,
    on_progress: OnProgress = lambda done, of: None,
) -> BalancingRun:
    """Balance with no current drawn until all SOCs lie within `difference`, or the time is up."""
    log = _Log(accumulator, period_s, on_progress, time_limit_s)
    first = float(np.ptp(accumulator.soc)) - difference
    while (left := float(np.ptp(accumulator.soc)) - difference) > 0.0:
        if log.seconds >= time_limit_s:
            return log.finished(0.0, "time")
        log.sample(0.0, 1.0 - left / first)
        log.step(balancer.decide(accumulator, period_s), 0.0, fan_duty=fan_duty)
    return log.finished(0.0, None)


class _Log:
    """Advances an accumulator and notes what happens to it."""

    def __init__(self, accumulator: Accumulator, period_s: float, on_progress: OnProgress, time_limit_s: float) -> None:
        self._accumulator = accumulator
        self.period_s = period_s
        self.seconds = 0.0
        self._on_progress = on_progress
        self._time_limit_s = time_limit_s
        self._sample_every = max(1, round(SAMPLE_S / period_s))
        self._samples = 0
        self._rows: list[tuple[float, FloatArray, FloatArray, FloatArray, float]] = []
        self._mean_soc = float(accumulator.soc.mean())
        self._bled_j = accumulator.bleed_energy_j
        self._charger_j = self._loss_j = 0.0
        self._max_degc = self._max_board_degc = self._highest_v = -np.inf

    def sample(self, current_a: float, done: float) -> None:
        """Note the state before a step, with how much of the work is done, 0..1; once a minute that is reported."""
        self._note_extremes()
        if self._samples % self._sample_every == 0:
            self._add_row(current_a)
            self._on_progress(round(PARTS * max(0.0, done, self.seconds / self._time_limit_s)), PARTS)
        self._samples += 1

    def step(self, balance: Balance, current_a: float, steps: int = 1, *, fan_duty: float = 0.0) -> None:
        """Advance by a period in so many steps, charging with a current [A]."""
        accumulator = self._accumulator
        if balance.heat_w is not None:
            accumulator.heat_w[:] = balance.heat_w
        for _ in range(steps):
            accumulator.step(
                self.period_s / steps,
                -current_a,
                bleeding=balance.bleeding,
                cell_current_a=balance.cell_current_a,
                fan_duty=fan_duty,
            )
        self.seconds += self.period_s
        self._charger_j += current_a * accumulator.outlet_voltage_v * self.period_s
        self._loss_j += balance.loss_w * self.period_s

    def finished(self, current_a: float, stopped_by: str | None) -> BalancingRun:
        """Return how it went."""
        self._note_extremes()
        self._add_row(current_a)
        time_h, soc, voltage_v, temperature_degc, current = zip(*self._rows, strict=True)
        accumulator = self._accumulator
        return BalancingRun(
            hours=self.seconds / SECONDS_PER_HOUR,
            max_degc=self._max_degc,
            max_board_degc=self._max_board_degc,
            soc_difference=float(np.ptp(accumulator.soc)),
            highest_soc=float(accumulator.soc.max()),
            highest_v=self._highest_v,
            stopped_by=stopped_by,
            charger_wh=self._charger_j / SECONDS_PER_HOUR,
            balancing_loss_wh=(accumulator.bleed_energy_j - self._bled_j + self._loss_j) / SECONDS_PER_HOUR,
            lost_soc=self._mean_soc - float(accumulator.soc.mean()),
            time_h=np.array(time_h),
            soc=np.stack(soc),
            voltage_v=np.stack(voltage_v),
            temperature_degc=np.stack(temperature_degc),
            current_a=np.array(current),
        )

    def _note_extremes(self) -> None:
        accumulator = self._accumulator
        self._max_degc = max(self._max_degc, float(accumulator.temperature_degc.max()))
        self._max_board_degc = max(self._max_board_degc, float(accumulator.board_temperature_degc.max()))
        self._highest_v = max(self._highest_v, float(accumulator.terminal_voltage_v.max()))

    def _add_row(self, current_a: float) -> None:
        accumulator = self._accumulator
        self._rows.append(
            (
                self.seconds / SECONDS_PER_HOUR,
                accumulator.soc.copy(),
                accumulator.terminal_voltage_v.copy(),
                accumulator.temperature_degc.copy(),
                current_a,
            )
        )
