"""The one tuning of the filters: what they assume about models, sensors and starts. Same for every cell.

Chosen on training runs only (see docs/explanation/estimation.md); the shapes have reasons, the numbers were measured.
"""

from __future__ import annotations

from dataclasses import dataclass

from app.estimation.arrays import FloatArray


@dataclass(frozen=True)
class Tuning:
    """Assumptions of the filters.

    The voltage error of an equivalent circuit is not white: it stays for `correlation_s`. A filter that takes it
    for white locks in, so its variance is multiplied by 1 + 2 correlation_s / dt, which leaves the information
    per second what it really is at any sampling rate.

    Attributes:
        model_error_v: standard deviation of the model's voltage at rest, the sensor's noise included; > 0 [V].
        model_error_rel: growth of it with current, as a share of the drop a lasting current causes.
        correlation_s: time over which the model's error stays [s].
        bias_v: error that no averaging removes; enters the sigma that is reported, not the gain [V].
        bias_start_v: what innovations that average out over `bias_s` are taken for before there are any [V].
        bias_s: innovations that do not average out over this time are such an error too [s].
        lasting_v: error of the model that stays for ten minutes, at rest: a state of the filter [V].
        lasting_rel: growth of it with what the current of the slowest RC pair drops, as a share of that.
        lasting_hysteresis: and by this share of the half gap between charge and discharge OCV.
        empty_soc: below this SOC at 25 degC, and below more of it in the cold, the model error grows ...
        empty_soc_max: ... at most below this ...
        empty_factor: ... up to this many times at SOC 0, in the cold more.
        soc_walk: random walk of the SOC, per square root of a second.
        branch_rel: standard deviation of an RC current, relative to the current.
        branch_c: the same at no current, in C.
        start_soc_sigma: sigma of a SOC that was given without one, for the plain filters.
        start_voltage_sigma: least sigma of a SOC read off the first voltage.
        start_branch_c: sigma of the RC currents at the start, in C.
        start_branch_rel: the same, relative to the current; so much of it is their mean ...
        start_branch_s: ... where the pair is faster than this: a slower one has followed the less of it [s].
        gate: innovations beyond this many sigma of model and state together are refused ...
        gate_hold_s: ... for at most this long; then they are accepted [s].
        gate_recovery: and the SOC sigma grows by this much per square root of a second.
        counter_soc_sigma: sigma of a SOC given without one, for the charge count.
        rest_c: below this current, in C, a cell rests [C].
        rest_s: a rest of this length from the start on is read as one [s].
        rest_least_s: one that ends earlier is read too, where a SOC was given, if it was this long [s].
        rest_v: sigma of the OCV read there: the curve itself [V].
        rest_noise_v: noise of a sample, by which a slope of the voltage may be no relaxation [V].
        rest_left_v: what a cell usually has left to relax where its voltage does not tell [V]; this and `rest_v` count
            twice where no SOC was given, for who does not know the SOC rather wakes up in a drive.
        rest_tail_s: what is left to relax, over the slope of the voltage [s].
        rest_settled: probability beforehand that a cell at rest has settled; else it was driven before, and relaxes ...
        rest_driven_c: ... by as much as a lasting current of this many C drops [C] ...
        rest_slow: ... and by this share of it too slowly to show as a slope.
        rest_unsettled: where no SOC was given, all that reads a voltage which is seen to relax errs by this share of
            its slope times `rest_tail_s`, at most by twice what `rest_driven_c` drops ...
        rest_lasts_s: ... for so long [s].
        rest_uncertainty_soc: a rest that gives the SOC much better than this leaves little of a claim to be exact.
        start_rough_sigma: sigma of a SOC that was given and is not as exact as its sigma.
        start_exact: probability that a SOC is as exact as its sigma ...
        start_rough: ... and that it is roughly right; otherwise it is no evidence.
        counter_gain: relative error of charge over capacity.
        counter_offset_c: offset of the current sensor, in C.
        start_unknown: weight of having no right start at all, once the voltages are in: density over all SOC.
        gain_sigma: sigma of the charge that moves the SOC against what the capacity says: old cells, wrong cell files.
        gain_uncertainty: variance of that over the filter's own when it is asked whether the capacity is right.
        gain_prior: probability beforehand that it is not.
        apart_soc_max: largest sigma of a disagreement: what lies many of them apart is no accident, however little the
            filter knows.
        wander_s: a count does not move within this time, so what the filter moves against it is the filter's error [s].
        wander_factor: variance of that error over the part of it that shows within the time: errors last longer.
        plateau_soc: where the lasting error is worth more SOC than this, the count goes before the filter.
        weighing_s: starts are weighed this often [s].
        conflict_s: time constant of the disagreement of filter and fusion [s].
        conflict_max: mean square of it, over its variance, above which the model is not valid.
        check_s: time constant of the self-check [s].
        check_rms_v: RMS innovation above which the model is not valid for the cell [V].
        check_bias_v: mean innovation above which it is not [V].
        drop_error_max: where resistances may be off by more than this share, the model is not valid.
    """

    model_error_v: float = 0.010
    model_error_rel: float = 0.15
    correlation_s: float = 12.0
    bias_v: float = 0.0025
    bias_start_v: float = 0.008
    bias_s: float = 20.0
    lasting_v: float = 0.008
    lasting_rel: float = 0.08
    lasting_hysteresis: float = 0.5
    empty_soc: float = 0.1
    empty_soc_max: float = 0.6
    empty_factor: float = 3.0
    soc_walk: float = 5e-5
    branch_rel: float = 0.1
    branch_c: float = 0.02
    start_soc_sigma: float = 0.25
    start_voltage_sigma: float = 0.05
    start_branch_c: float = 0.5
    start_branch_rel: float = 0.5
    start_branch_s: float = 50.0
    gate: float = 5.0
    gate_hold_s: float = 2.0
    gate_recovery: float = 0.02
    counter_soc_sigma: float = 0.003
    rest_c: float = 0.1
    rest_s: float = 16.0
    rest_least_s: float = 2.0
    rest_v: float = 0.007
    rest_noise_v: float = 0.0015
    rest_left_v: float = 0.004
    rest_tail_s: float = 120.0
    rest_settled: float = 0.7
    rest_driven_c: float = 0.5
    rest_slow: float = 0.4
    rest_unsettled: float = 0.25
    rest_lasts_s: float = 300.0
    rest_uncertainty_soc: float = 0.03
    start_rough_sigma: float = 0.1
    start_exact: float = 0.5
    start_rough: float = 0.4
    counter_gain: float = 0.007
    counter_offset_c: float = 0.01
    start_unknown: float = 0.05
    gain_sigma: float = 0.07
    gain_uncertainty: float = 2.0
    gain_prior: float = 0.5
    apart_soc_max: float = 0.06
    wander_s: float = 200.0
    wander_factor: float = 2.0
    plateau_soc: float = 0.1
    weighing_s: float = 1.0
    conflict_s: float = 100.0
    conflict_max: float = 9.0
    check_s: float = 120.0
    check_rms_v: float = 0.04
    check_bias_v: float = 0.025
    drop_error_max: float = 0.25

    def voltage_variance(self, drop_v: FloatArray) -> FloatArray:
        """Return the variance of the model's voltage [V^2] where a lasting current would drop `drop_v`."""
        with_current_v = self.model_error_rel * drop_v
        return self.model_error_v**2 + with_current_v**2

    def correlation_factor(self, dt_s: float) -> float:
        """Return the growth of one sample's variance that keeps the information per second honest."""
        return 1.0 + 2.0 * self.correlation_s / max(dt_s, 1e-3)
