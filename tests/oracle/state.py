"""What a filter remembers of its cells, and what one measurement and one step mean to them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from app.estimation.arrays import BoolArray, FloatArray
from app.estimation.cell_model.circuit import SECONDS_PER_HOUR
from app.estimation.filters.setup import FilterSetup
from app.estimation.filters.tables import COLD, DROP_ERROR, LASTING_DROP, OCV_ERROR, Place

SOC_MIN: Final = -0.05  # the filter's SOC is held here
SOC_MAX: Final = 1.05
SOC_VARIANCE_MAX: Final = 0.25  # no cell's SOC is less known than this
LASTING_VARIANCE_MAX: Final = 0.04  # no model errs by more, whatever the current [V^2]
VARIANCE_STEP: Final = 1e-12  # added at every step, in units of 1 and C^2: keeps P definite
TICK_S: Final = 1e-3  # times that lie no farther apart are the same: sums of steps round
SLOPE_FLOOR_V: Final = 0.02  # least slope by which a voltage error is turned into one of SOC
N_GIVEN: Final = 2  # hypotheses of a SOC that was given: exact, roughly right
N_STARTS: Final = 4  # hypotheses of the SOC at the start: those, and a voltage at rest: settled, relaxing
LEAST_VARIANCE: Final = 1e-8  # variance of a SOC at the start
TEMPERATURE_UNKNOWN_DEGC: Final = 25.0
TEMPERATURE_MAX_DEGC: Final = 200.0  # beyond it, either way, the sensor is broken
VOLTAGE_MIN_V: Final = 0.5  # a cell that reads 0 is not connected
VOLTAGE_MAX_V: Final = 6.0  # 6.5535 V is what the cell monitor says when it has not measured


@dataclass(frozen=True)
class State:
    """State of n cells; every array is (n,) unless it says otherwise. Names as in `vw_cells`.

    Attributes:
        soc: mean of the filter's state: SOC, 0..1.
        branch_a: (n_rc, n) and currents through the RC resistors [A].
        cov: (1 + n_rc, 1 + n_rc, n) its covariance P.
        gain: share by which charge moves the SOC more than the capacity says.
        gain_v2: its variance M.
        gain_step: what the last sample moved it by, NaN where it taught nothing.
        gain_slope: (1 + n_rc, n) how the mean would move with it, V.
        hysteresis: -1 after discharge .. 1 after charge.
        temperature_degc: last temperature that was measured [degC].
        capacity_ah: of each cell [Ah].
        resistance: of each cell over that of its model.
        refused_s: for how long innovations have been refused without a break [s].
        count_soc: SOC by counting charge.
        count_gain: its sigma by the gain of the current sensor.
        count_offset: its sigma by the offset of the current sensor.
        anchor_v2: variance of the SOC where the count began.
        rest_mean_v: mean voltage of a rest from the start on [V].
        rest_moment: integral of voltage times time, both less their means, over it [V s^2].
        unsettled_v2: mean square by which that rest is off: it still relaxes and no SOC was given [V^2].
        drawn: charge taken out since the start, over the capacity.
        start_soc: (4, n) SOC at the start: as given, as exact as was said; the same, roughly; as read at rest, settled;
            the same, relaxing.
        start_v2: (4, n) its variance by each hypothesis.
        start_weight: (4, n) their probabilities before any drive.
        best_soc: SOC at the start by the filter when it was the surest, counted back.
        best_v2: its variance then.
        best_drawn: the charge drawn until then, over the capacity.
        best_offset: `count_offset` then.
        fused_soc: what is reported, counted on between two looks.
        fused_v2: its variance.
        fused_gain: the gain it is counted with: that of the filter, as far as it is believed.
        conflict: mean square of filter minus fusion over its variance.
        apart: mean of the filter's SOC minus the count's.
        apart_v2: mean of the variance that the filter gave itself meanwhile.
        wander_v2: variance that the filter shows against the count beyond that mean.
        check_mean_v: mean of the scaled innovation over `check_s` [V].
        check_square_v2: mean of its square over `check_s` [V^2].
        slow_mean_v: mean of the scaled innovation over `bias_s` [V].
        slow_square_v2: mean of the square of that over `check_s` [V^2].
    """

    soc: FloatArray
    branch_a: FloatArray
    cov: FloatArray
    gain: FloatArray
    gain_v2: FloatArray
    gain_step: FloatArray
    gain_slope: FloatArray
    hysteresis: FloatArray
    temperature_degc: FloatArray
    capacity_ah: FloatArray
    resistance: FloatArray
    refused_s: FloatArray
    count_soc: FloatArray
    count_gain: FloatArray
    count_offset: FloatArray
    anchor_v2: FloatArray
    rest_mean_v: FloatArray
    rest_moment: FloatArray
    unsettled_v2: FloatArray
    drawn: FloatArray
    start_soc: FloatArray
    start_v2: FloatArray
    start_weight: FloatArray
    best_soc: FloatArray
    best_v2: FloatArray
    best_drawn: FloatArray
    best_offset: FloatArray
    fused_soc: FloatArray
    fused_v2: FloatArray
    fused_gain: FloatArray
    conflict: FloatArray
    apart: FloatArray
    apart_v2: FloatArray
    wander_v2: FloatArray
    check_mean_v: FloatArray
    check_square_v2: FloatArray
    slow_mean_v: FloatArray
    slow_square_v2: FloatArray

    @property
    def count_v2(self) -> FloatArray:
        """(n,) variance of the counted SOC."""
        return self.count_gain**2 + self.count_offset**2 + self.anchor_v2


def initial_state(setup: FilterSetup, n_cells: int) -> State:
    """Return the state before the first sample: temperatures unknown, cells as their model has them."""
    m, zeros = setup.cell.n_rc, np.zeros(n_cells)
    others = dict.fromkeys(State.__dataclass_fields__, zeros)
    return State(
        **others
        | {
            "branch_a": np.zeros((m, n_cells)),
            "cov": np.zeros((1 + m, 1 + m, n_cells)),
            "gain_slope": np.zeros((1 + m, n_cells)),
            **dict.fromkeys(("start_soc", "start_v2", "start_weight"), np.zeros((N_STARTS, n_cells))),
            "temperature_degc": np.full(n_cells, TEMPERATURE_UNKNOWN_DEGC),
            "capacity_ah": np.full(n_cells, setup.cell.model.capacity_ah),
            "resistance": np.ones(n_cells),
            "best_v2": np.full(n_cells, SOC_VARIANCE_MAX),
        }
    )


@dataclass(frozen=True)
class Measurement:
    """What one sample says of n cells.

    Attributes:
        voltage_v: (n,) [V]; NaN where not measured.
        place: of the temperatures in the tables.
        uncertainty: (5, n) of `CellTables.uncertainty_at`: what is not known at these temperatures.
    """

    voltage_v: FloatArray
    place: Place
    uncertainty: FloatArray

    @property
    def is_measured(self) -> BoolArray:
        """(n,) whether the voltage was measured."""
        return ~np.isnan(self.voltage_v)


def read(
    setup: FilterSetup, state: State, voltage_v: FloatArray, temperature_degc: FloatArray
) -> tuple[State, Measurement]:
    """Return one sample as the filter uses it: what is impossible is missing, a missing temperature is the last one.

    Args:
        setup: the filter.
        state: before the sample.
        voltage_v: (n,) [V].
        temperature_degc: (n,) [degC].

    Returns:
        The state with the temperatures now in force, and the measurement.
    """
    cell = setup.cell
    voltage = np.where((voltage_v > VOLTAGE_MIN_V) & (voltage_v < VOLTAGE_MAX_V), voltage_v, np.nan)
    known = np.abs(temperature_degc) < TEMPERATURE_MAX_DEGC
    degc = np.where(known, temperature_degc, state.temperature_degc)
    measured = Measurement(voltage, cell.place_temperature(degc), cell.uncertainty_at(degc))
    return replace(state, temperature_degc=degc), measured


@dataclass(frozen=True)
class Motion:
    """A step: its length [s], the current held over it [A], and what they mean to every cell.

    Attributes:
        moved_ah: charge taken out; charging counts times the efficiency [Ah].
        correlation: growth of it for the gain: errors that last average out less.
        is_beyond: whether a real share of the charge flowed at currents that the cell file has not seen.
        weighed_s: since the starts were last weighed; 0 where it is not time to weigh them [s].
        rest_share: of this sample in the mean of a rest from the start on.
        rest_lever: and in its moment [s^2].
        read_rest_s: length of a rest that is to be read now; 0 = none [s].
        is_rest_on: whether it is not over: what it says now is used once and not kept.
        is_rest_cut: whether it ended before it was whole: whoever gave no SOC wakes up in a drive.
        is_whole_rest: whether it lasts on: a shorter one is heard about a SOC that was given only.
    """

    dt_s: float
    current_a: float
    moved_ah: float
    correlation: float
    is_beyond: bool
    weighed_s: float
    rest_share: float
    rest_lever: float
    read_rest_s: float
    is_rest_on: bool
    is_rest_cut: bool
    is_whole_rest: bool

    def share(self, time_s: float) -> float:
        """Return 1 - exp(-dt / T), by which a mean over T moves towards a new value."""
        return 1.0 - math.exp(-self.dt_s / time_s)

    def weighed_share(self, time_s: float) -> float:
        """Return the same for what moves only when the starts are weighed."""
        return 1.0 - math.exp(-self.weighed_s / time_s)


def motion_of(
    setup: FilterSetup,
    dt_s: float,
    current_a: float,
    since_s: float = 0.0,
    rest_s: float = -1.0,
    is_beyond: bool = False,
) -> Motion:
    """Return what a step means.

    Args:
        setup: the filter.
        dt_s: its length [s].
        current_a: held over it [A].
        since_s: at its end, since the starts were last weighed [s].
        rest_s: of rest from the start on before it; negative = none, or read already [s].
        is_beyond: whether a real share of the charge flowed at currents that the cell file has not seen.
    """
    model, tuning = setup.cell.model, setup.tuning
    rested_s, has_rested = rest_s + dt_s, rest_s >= 0.0 and dt_s > 0.0
    rests = has_rested and abs(current_a) < tuning.rest_c * model.capacity_ah
    weighed_s = since_s if since_s >= tuning.weighing_s - TICK_S else 0.0
    is_whole = rests and rested_s >= tuning.rest_s - TICK_S
    is_on = rests and not is_whole and weighed_s > 0.0
    is_broken = has_rested and not rests and rest_s >= 2.0 * tuning.weighing_s - TICK_S
    kept = model.coulombic_efficiency if current_a < 0.0 else 1.0
    return Motion(
        dt_s=dt_s,
        current_a=current_a,
        moved_ah=kept * current_a * dt_s / SECONDS_PER_HOUR,
        correlation=tuning.correlation_factor(dt_s),
        is_beyond=is_beyond,
        weighed_s=weighed_s,
        rest_share=dt_s / rested_s if rests else 0.0,
        rest_lever=rest_s * dt_s / 2.0 if rests else 0.0,
        read_rest_s=rested_s if is_whole or is_on else rest_s if is_broken else 0.0,
        is_rest_on=is_on,
        is_rest_cut=has_rested and not rests,
        is_whole_rest=is_whole,
    )


def noise_v2(setup: FilterSetup, motion: Motion, measured: Measurement) -> FloatArray:
    """Return (n,) r = r_0 + (share of the drop that a lasting current causes here)^2, uncertainty included [V^2]."""
    drop_v = measured.uncertainty[LASTING_DROP] * motion.current_a
    return np.asarray(setup.tuning.voltage_variance(drop_v) + (measured.uncertainty[DROP_ERROR] * drop_v) ** 2)


def empty_growth(setup: FilterSetup, state: State, measured: Measurement) -> FloatArray:
    """Return (n,) growth of the model's error where the cell is nearly empty, which in the cold it looks early."""
    tuning, cold = setup.tuning, measured.uncertainty[COLD]
    empty = np.minimum(tuning.empty_soc * cold, 1.0)
    low = np.maximum(empty - state.soc, 0.0) / empty
    return np.asarray(1.0 + low * (tuning.empty_factor * cold - 1.0))


def lasting_v2(setup: FilterSetup, state: State, motion: Motion, measured: Measurement) -> FloatArray:
    """Return (n,) the variance that the lasting error comes to [V^2].

    At rest, by hysteresis, and as a share of what the current of the slowest RC pair drops.
    """
    tuning, cell = setup.tuning, setup.cell
    slow_a = motion.current_a if cell.slow_pair < 0 else state.branch_a[cell.slow_pair]
    drop_v = measured.uncertainty[LASTING_DROP] * slow_a * empty_growth(setup, state, measured)
    share2 = tuning.lasting_rel**2 + measured.uncertainty[DROP_ERROR] ** 2
    rest_v2 = tuning.lasting_v**2 + measured.uncertainty[OCV_ERROR] ** 2
    rest_v2 = rest_v2 + cell.model.hysteresis_v**2 / 3.0
    return np.asarray(np.minimum(rest_v2 + share2 * drop_v**2, LASTING_VARIANCE_MAX))
