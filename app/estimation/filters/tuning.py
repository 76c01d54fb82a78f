"""The one tuning of the filters: what they assume about models, sensors and starts. Same for every cell.

Chosen on training runs only. Behind each number stands what it rests on: a fact of sensors, a test, or the row of
docs/reference/accuracy.md that errs most without it, and by how many points of SOC more (median; "half" where the
number is halved). With a wrong OCV: that of a 1C discharge, whose tests are refused by now.
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
        bias_s: innovations that do not average out over this time are an error that no averaging removes [s].
        lasting_v: error of the model that stays for ten minutes, at rest: a state of the filter; before there are
            innovations, what does not average out of them is as large [V].
        lasting_rel: growth of it with what the current of the slowest RC pair drops, as a share of that.
        empty_soc: below this SOC at 25 degC, and below more of it in the cold, the model error grows ...
        empty_factor: ... up to this many times at SOC 0, in the cold more.
        soc_walk: random walk of the SOC, per square root of a second.
        branch_rel: standard deviation of an RC current, relative to the current.
        start_soc_sigma: sigma of a SOC that was given without one, for the plain filters.
        start_voltage_sigma: least sigma of a SOC read off the first voltage.
        driven_c: current that a cell may have had before it was seen: sigma of the RC currents at the start [C].
        start_branch_rel: the same, relative to the current; so much of it is their mean ...
        start_branch_s: ... where the pair is faster than this: a slower one has followed the less of it [s].
        gate: innovations beyond this many sigma of model and state together are refused, and a model is not valid where
            filter and fusion lie as far apart ...
        gate_hold_s: ... for at most this long; then innovations are accepted [s].
        gate_recovery: and the SOC sigma grows by this much per square root of a second.
        counter_soc_sigma: sigma of a SOC given without one, for the charge count.
        rest_c: below this current, in C, a cell rests [C].
        rest_s: a rest of this length from the start on is read as one; one of two weighings is read too, where a SOC
            was given [s].
        rest_v: sigma of the OCV read there: the curve itself [V].
        rest_noise_v: noise of a sample, by which a slope of the voltage may be no relaxation [V].
        rest_left_v: what a cell usually has left to relax where its voltage does not show it [V]; this and `rest_v`
            count twice where no SOC was given, for who does not know the SOC rather wakes up in a drive.
        rest_tail_s: what is left to relax, over the slope of the voltage [s].
        rest_settled: probability beforehand that a cell at rest has settled; else it was driven by `driven_c` ...
        rest_slow: ... and relaxes by this share of what that drops too slowly to show as a slope.
        rest_unsettled: where no SOC was given, all that reads a voltage which is seen to relax errs by this share of
            its slope times `rest_tail_s`, at most by twice what `driven_c` drops.
        rest_uncertainty_soc: a rest that gives the SOC much better than this leaves little of a claim to be exact.
        rough_soc: sigma of a SOC that was given and is not as exact as its sigma. Where the lasting error is worth more
            SOC than this, the count goes before the filter.
        start_exact: probability that a SOC is as exact as its sigma ...
        start_rough: ... and that it is roughly right; otherwise it is no evidence.
        counter_gain: relative error of charge over capacity.
        counter_offset_c: offset of the current sensor, in C.
        start_unknown: weight of having no right start at all, once the voltages are in: density over all SOC.
        gain_sigma: sigma of the charge that moves the SOC against what the capacity says: old cells, wrong cell files.
        hidden_factor: variance of an error over the part of it that the filter sees: errors last longer.
        apart_soc_max: largest sigma of a disagreement: what lies many of them apart is no accident, however little the
            filter knows.
        wander_s: a count does not move within this time, so what the filter moves against it is the filter's error [s].
        weighing_s: starts are weighed this often [s].
        check_s: time constant of the self-check [s].
        check_rms_v: RMS innovation above which the model is not valid for the cell [V].
        check_bias_v: mean innovation above which it is not [V].
        drop_error_max: where resistances may be off by more than this share, the model is not valid.
    """

    model_error_v: float = 0.010  # half: capacity 11 % too large, 5C NMC, 2.3
    model_error_rel: float = 0.15  # half: right start at 0 degC 0.7
    correlation_s: float = 12.0  # half: capacity 11 % too large, 5C NMC, 1.0
    bias_s: float = 20.0  # double: truth within 3 sigma 1.3 % less often with a wrong OCV
    lasting_v: float = 0.008  # half: truth within 3 sigma 7 % less often with a wrong OCV
    lasting_rel: float = 0.08  # half: up to 0.3, and truth within 3 sigma 1.5 % less often with a wrong OCV
    empty_soc: float = 0.1  # none: 10 low at 0 degC, model of 25 degC, 0.9
    empty_factor: float = 3.0  # none: the same row 0.9
    soc_walk: float = 5e-5  # none: capacity 11 % too large at 0 degC 0.04
    branch_rel: float = 0.1  # none: 5C NMC 0.6
    start_soc_sigma: float = 0.25  # an EKF leaves a start half of the range off: tests/numeric/test_filters_limits.py
    start_voltage_sigma: float = 0.05  # none: 5C NMC, 5 off, 0.6
    driven_c: float = 0.5  # none: 10 low at 0 degC 1.3
    start_branch_rel: float = 0.5  # half: unknown in mid-drive, LFP, 0.8
    start_branch_s: float = 50.0  # none: unknown in mid-drive, LFP, 4.7
    gate: float = 5.0  # none: 10 low at 0 degC 0.3
    gate_hold_s: float = 2.0  # half: means of a second, 5C NMC, 0.4; 12 s: model of 25 degC at 0 degC 0.5
    gate_recovery: float = 0.02  # none: 10 low at 0 degC 0.3
    counter_soc_sigma: float = 0.003  # a count from full; 0.01: means of a second at 0 degC 0.06
    rest_c: float = 0.1  # half: 5C NMC, 5 off, 1.2
    rest_s: float = 16.0  # half: 5C NMC, 5 off, 0.9
    rest_v: float = 0.007  # 0.008: LFP, 5 low, 0.05
    rest_noise_v: float = 0.0015  # sensors: 1.2 mV RMS and 0.1 mV of steps; none: means of a second, LFP, 0.5
    rest_left_v: float = 0.004  # none: 5C NMC, 5 off, 0.6
    rest_tail_s: float = 120.0  # half: capacity 11 % too large, 5C NMC, 0.2
    rest_settled: float = 0.7  # 0.5: 5C NMC, 5 off, 0.3
    rest_slow: float = 0.4  # none: capacity 11 % too large, 5C NMC, 0.3
    rest_unsettled: float = 0.25  # tests/unit/app/estimation/filters/test_hostile_starts.py, no row
    rest_uncertainty_soc: float = 0.03  # none: a start at rest 0.1
    rough_soc: float = 0.1  # 0.06: 10 low at 0 degC 1.8
    start_exact: float = 0.5  # 0.7: 10 off, 5C NMC, 0.5; 0.3: LFP 0.2
    start_rough: float = 0.4  # the same; the rest is the reading's
    counter_gain: float = 0.007  # sensors: gain +-0.5 % and the capacity of a cell
    counter_offset_c: float = 0.01  # sensors: offset +-0.0067C
    start_unknown: float = 0.05  # none: a wrong start stays
    gain_sigma: float = 0.07  # 0.1: model of 25 degC at 0 degC 0.6
    hidden_factor: float = 2.0  # 1: truth within 3 sigma 11 % less often with a wrong OCV
    apart_soc_max: float = 0.06  # 0.1: a start half of the range off moves the fusion: tests/unit/oracle/test_fusion.py
    wander_s: float = 200.0  # half: truth within 3 sigma 10 % less often with a wrong OCV
    weighing_s: float = 1.0  # time: 0.01 s changes no row
    check_s: float = 120.0  # half: no row by 0.05
    check_rms_v: float = 0.04  # none: right start at 0 degC counts as valid in 16 % more of the time
    check_bias_v: float = 0.025  # none: means of a second at 25 degC 1 % more
    drop_error_max: float = 0.25  # some 20 K from what was measured, where energies are known to 12 kJ/mol

    def voltage_variance(self, drop_v: FloatArray) -> FloatArray:
        """Return the variance of the model's voltage [V^2] where a lasting current would drop `drop_v`."""
        with_current_v = self.model_error_rel * drop_v
        return self.model_error_v**2 + with_current_v**2

    def correlation_factor(self, dt_s: float) -> float:
        """Return the growth of one sample's variance that keeps the information per second honest."""
        return 1.0 + 2.0 * self.correlation_s / max(dt_s, 1e-3)
