"""A charge from start to end: constant current, constant voltage of the highest cell, a balancer, a supervisor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from simulator.accumulator import Accumulator
from simulator.cell_data import FloatArray
from simulator.errors import ParameterError
from tests.balancing.balancers import Balancer

SECONDS_PER_HOUR = 3600.0
SAMPLE_S = 60.0  # of the traces

_Row: TypeAlias = tuple[float, FloatArray, FloatArray, FloatArray, float]


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
    control_period_s: float = 1.0  # of supervisor, balancer and regulator
    dt_s: float = 1.0  # of the physics in between
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
class ChargeResult:
    """How a charge went. Traces have one entry a minute."""

    hours: float
    max_degc: float
    soc_difference: float  # highest less lowest at the end
    highest_soc: float
    highest_v: float
    stopped_by: str | None  # the supervisor's word, "time" at the limit, None when the charge ended as planned
    charger_wh: float
    balancing_loss_wh: float
    time_h: FloatArray
    soc: FloatArray  # (samples, n)
    voltage_v: FloatArray
    temperature_degc: FloatArray
    current_a: FloatArray


def charge(
    accumulator: Accumulator, balancer: Balancer, plan: ChargePlan, supervisor: Supervisor | None = None
) -> ChargeResult:
    """Charge until the plan's end, the supervisor's objection, or the time limit; the accumulator is left there."""
    supervisor = supervisor or Supervisor()
    steps = max(1, round(plan.control_period_s / plan.dt_s))
    period_s = steps * plan.dt_s
    sample_every = max(1, round(SAMPLE_S / period_s))
    current_a, seconds = plan.current_a, 0.0
    max_degc, highest_v, charger_j, extra_loss_j = -np.inf, -np.inf, 0.0, 0.0
    stopped_by: str | None = None
    rows: list[_Row] = []
    for k in range(round(plan.time_limit_s / period_s)):
        stopped_by = supervisor.objection(accumulator)
        if stopped_by is not None:
            break
        cell_v = float(accumulator.terminal_voltage_v.max())
        max_degc = max(max_degc, float(accumulator.temperature_degc.max()))
        highest_v = max(highest_v, cell_v)
        current_a = plan.next_current_a(current_a, cell_v)
        if k % sample_every == 0:
            rows.append(_row(seconds, accumulator, current_a))
        if current_a < plan.end_a:
            break
        balance = balancer.decide(accumulator, period_s)
        if balance.heat_w is not None:
            accumulator.heat_w[:] = balance.heat_w
        for _ in range(steps):
            accumulator.step(plan.dt_s, -current_a, bleeding=balance.bleeding, cell_current_a=balance.cell_current_a)
        seconds += period_s
        charger_j += current_a * accumulator.outlet_voltage_v * period_s
        extra_loss_j += balance.loss_w * period_s
    else:
        stopped_by = "time"
    rows.append(_row(seconds, accumulator, current_a))
    time_h, soc, voltage_v, temperature_degc, current = zip(*rows, strict=True)
    return ChargeResult(
        hours=seconds / SECONDS_PER_HOUR,
        max_degc=max(max_degc, float(accumulator.temperature_degc.max())),
        soc_difference=float(accumulator.soc.max() - accumulator.soc.min()),
        highest_soc=float(accumulator.soc.max()),
        highest_v=highest_v,
        stopped_by=stopped_by,
        charger_wh=charger_j / SECONDS_PER_HOUR,
        balancing_loss_wh=(accumulator.bleed_energy_j + extra_loss_j) / SECONDS_PER_HOUR,
        time_h=np.array(time_h),
        soc=np.stack(soc),
        voltage_v=np.stack(voltage_v),
        temperature_degc=np.stack(temperature_degc),
        current_a=np.array(current),
    )


@dataclass(frozen=True)
class EqualiseResult:
    """How balancing at rest went."""

    hours: float
    soc_difference: float  # highest less lowest at the end
    max_degc: float
    max_board_degc: float
    loss_wh: float
    lost_soc: float  # mean SOC given up


def equalise(
    accumulator: Accumulator,
    balancer: Balancer,
    *,
    difference: float,
    period_s: float = 10.0,
    fan_duty: float = 0.0,
    time_limit_s: float = 48 * SECONDS_PER_HOUR,
) -> EqualiseResult:
    """Balance with no current drawn until all SOCs lie within `difference`, or the time is up."""
    mean_soc = float(accumulator.soc.mean())
    bled_j, extra_j, seconds, max_degc, max_board_degc = accumulator.bleed_energy_j, 0.0, 0.0, -np.inf, -np.inf
    while seconds < time_limit_s and accumulator.soc.max() - accumulator.soc.min() > difference:
        balance = balancer.decide(accumulator, period_s)
        if balance.heat_w is not None:
            accumulator.heat_w[:] = balance.heat_w
        accumulator.step(
            period_s, 0.0, bleeding=balance.bleeding, cell_current_a=balance.cell_current_a, fan_duty=fan_duty
        )
        seconds += period_s
        extra_j += balance.loss_w * period_s
        max_degc = max(max_degc, float(accumulator.temperature_degc.max()))
        max_board_degc = max(max_board_degc, float(accumulator.board_temperature_degc.max()))
    return EqualiseResult(
        hours=seconds / SECONDS_PER_HOUR,
        soc_difference=float(accumulator.soc.max() - accumulator.soc.min()),
        max_degc=max_degc,
        max_board_degc=max_board_degc,
        loss_wh=(accumulator.bleed_energy_j - bled_j + extra_j) / SECONDS_PER_HOUR,
        lost_soc=mean_soc - float(accumulator.soc.mean()),
    )


def _row(
    seconds: float, accumulator: Accumulator, current_a: float
) -> tuple[float, FloatArray, FloatArray, FloatArray, float]:
    return (
        seconds / SECONDS_PER_HOUR,
        accumulator.soc.copy(),
        accumulator.terminal_voltage_v.copy(),
        accumulator.temperature_degc.copy(),
        current_a,
    )
