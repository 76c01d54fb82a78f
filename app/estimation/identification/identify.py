"""Fits a cell model to measurements: slow tests and rests for the OCV, pulses and drives for what current does.

Arrays in, a `CellModel` and a report out; numpy alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import ACTIVATION_SIGMA_J_MOL, MAX_RC_PAIRS, CellModel
from app.estimation.cell_model.evidence import Evidence, held_currents
from app.estimation.cell_model.ocv import OcvCurve
from app.estimation.errors import ModelError
from app.estimation.identification.parts import (
    REST_CURRENT_C,
    OcvShift,
    Part,
    choose_capacity,
    has_soc_column,
    reference_soc,
    typical_resistance,
)
from app.estimation.identification.slow_tests import FLAT_V, SlowCurves, read_slow
from app.estimation.identification.surface_fit import (
    REFERENCE_DEGC,
    ROUNDS,
    SOC_GRID,
    SurfaceFit,
    branch_current,
    fit_surface,
)
from app.estimation.recording.cell_recording import Recording, believable

RATED_C: Final = 4.0  # a race draws at least this much: pulses below it leave the fit without evidence
JUDGED_SOC: Final = 0.05  # below, the voltage falls so fast that its error says nothing about the SOC
VOLTAGE_RMS_LIMIT_V: Final = 0.03  # above, estimates drift: see docs/explanation/identification.md
SOC_BEYOND: Final = 0.05  # a recording further beyond full or empty is not on the SOC axis
OCV_POINTS: Final = 101
SEEN_STEP_K: Final = 5.0  # step of the list of measured temperatures
SEEN_SHARE: Final = 0.01  # share of the rows of a recording at a temperature that make it measured
SPAN_MIN_K: Final = 8.0  # tests that lie apart this far show the energies
FIT_SIGMA_J_MOL: Final = 6e3  # how far beyond its temperatures a measured energy holds
ERROR_STEP_K: Final = 10.0  # step of the residual by temperature ...
ERROR_SOC: Final = np.array([0.0, 0.1, 0.2, 0.4, 0.7, 1.0])  # ... by SOC, between these ...
ERROR_C: Final = np.array([0.0, 0.1, 0.5, 1.0, 2.0, 4.0, 8.0])  # ... and by current [C]
UNKNOWN: Final = 0.8  # share of the prior's sigma: a number that no recording shows
SIGMA_OF: Final = {
    "ohmic": "r0_ohm",
    "ohmic_energy": "r0_j_mol",
    "e": "kinetics_v",
    "i0": "kinetics_a",
    "kinetics_energy": "kinetics_j_mol",
    "low": "low_exponent",
    "high": "high_exponent",
    "diffusion_energy": "diffusion_j_mol",
    "lag_energy": "lag_j_mol",
    "correction": "correction",
    "entropy": "entropy_v_k",
}  # unknowns of the fit, and their names in a cell file
TESTS: Final = (
    ("kinetics_energy", "a pulse test at another temperature, 0 to 10 degC: it shows what the cold does"),
    ("diffusion_energy", "a drive in the cold: it shows how diffusion slows down there"),
    ("i0", "pulses of 10 s at the largest current of the cell: they show how the drop bends with current"),
    ("d1", "a drive of half an hour at the currents of a race: it shows diffusion"),
)
OnProgress = Callable[[int, int], None]


@dataclass(frozen=True)
class PartFit:
    """The fit of the model to one recording, open loop from its reference SOC.

    Attributes:
        name: the file.
        is_drive: a drive; else a pulse test.
        rows: samples in the recording.
        voltage_rms_v: RMS of measured minus modelled voltage where the cell is between 5 and 100 % SOC [V].
        current_max_a: largest current magnitude [A].
        soc_range: lowest and highest SOC.
        temperature_range_degc: lowest and highest temperature [degC], NaN if not recorded.
        soc: (rows,) reference SOC.
        residual_v: (rows,) measured minus modelled voltage [V].
    """

    name: str
    is_drive: bool
    rows: int
    voltage_rms_v: float
    current_max_a: float
    soc_range: tuple[float, float]
    temperature_range_degc: tuple[float, float]
    soc: FloatArray
    residual_v: FloatArray


@dataclass(frozen=True)
class Identification:
    """A fitted cell, how well it fits, what was assumed (`notes`) and what to beware of (`warnings`).

    `learned` has the sigma of each unknown of the fit over that of its prior: 1 = nothing was learned of it.
    `next_test` is the test that would show most of what is still as it usually is.
    """

    model: CellModel
    parts: tuple[PartFit, ...]
    tau_s: tuple[float, ...]
    learned: Mapping[str, float]
    counted_ah: float
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    next_test: str | None = None


def identify(
    slow_tests: Sequence[Recording],
    pulses: Sequence[Recording],
    drives: Sequence[Recording] = (),
    n_rc: int = 2,
    name: str = "cell",
    on_progress: OnProgress = lambda done, of: None,
    is_circuit: bool = False,
) -> Identification:
    """Return the cell model that explains the recordings best.

    Args:
        slow_tests: discharge (and charge) at C/10 or less.
        pulses: pulse tests, at one or several temperatures; discharges between pulses may come in files of their own.
        drives: drives like those the model is for.
        n_rc: number of first-order lags, 0..4.
        name: name of the cell.
        on_progress: called with how many rounds are done, of how many.
        is_circuit: an equivalent circuit of n_rc RC pairs, as in the theses, without a SOC of the surface.

    Raises:
        ModelError: a recording lacks what the fit needs; the error names it.
    """
    if not 0 <= n_rc <= MAX_RC_PAIRS:
        raise ModelError("--rc", f"{n_rc} lags; 0 to {MAX_RC_PAIRS} can be fitted")
    if not pulses and not drives:
        raise ModelError("--pulses", "neither pulses nor a drive: nothing says what current does")
    slow = read_slow(slow_tests, pulses)
    notes = list(slow.notes)
    typical_ohm = typical_resistance([*pulses, *drives])
    capacity_ah = choose_capacity(slow, [*slow_tests, *pulses, *drives], typical_ohm, notes)
    pulses, drives = ([believable(r, capacity_ah) for r in given] for given in (pulses, drives))
    measured = [*pulses, *drives]
    _check_load(measured, capacity_ah)
    rounds = count(1)

    def report_round() -> None:
        on_progress(next(rounds), ROUNDS)

    def laid(notes: list[str], shift: OcvShift | None = None) -> list[Part]:
        return [
            Part(
                r, reference_soc(r, capacity_ah, slow, typical_ohm, notes, shift), is_drive=any(r is d for d in drives)
            )
            for r in measured
        ]

    parts = laid(notes)
    columned = [part for part in parts if has_soc_column(part.recording)]
    if 0 < len(columned) < len(parts):
        # the rests of the others lie on the OCV at their temperature, which those with a soc column show
        first = fit_surface(columned, slow, capacity_ah, typical_ohm, n_rc, has_surface=not is_circuit)
        parts = laid([], _ocv_shift(first, typical_temperature(slow_tests)))
    fit = fit_surface(parts, slow, capacity_ah, typical_ohm, n_rc, report_round, not is_circuit)
    source = f"identified from {', '.join(r.source for r in (*slow_tests, *measured))}"
    model = _cell_model(fit, slow, measured, capacity_ah, name, source)
    fits = tuple(_part_fit(model, part) for part in parts)
    judged = [fit for fit in fits if fit.is_drive] or list(fits)
    model = replace(
        model,
        fit_voltage_rms_v=float(np.sqrt(np.mean([fit.voltage_rms_v**2 for fit in judged]))),
        fit_current_max_a=max(fit.current_max_a for fit in fits),
        evidence=_evidence(fit, slow, parts, fits, capacity_ah),
    )
    if model.measured_degc.size and float(np.ptp(model.measured_degc)) < SPAN_MIN_K:
        notes.append(_one_temperature(model))
    warnings = [*slow.warnings, *_warnings(fits, capacity_ah), *_flat(slow)]
    tau_s = tuple(lag.tau_s for lag in fit.surface.lags)
    return Identification(
        model,
        fits,
        tau_s,
        fit.learned,
        slow.counted_ah,
        tuple(notes),
        tuple(warnings),
        next_test(fit.learned, slow.has_charge),
    )


def _check_load(recordings: Sequence[Recording], capacity_ah: float) -> None:
    if not any((np.abs(r.current_a) > REST_CURRENT_C * capacity_ah).any() for r in recordings):
        problem = f"no current flows in them that counts for a cell of {capacity_ah:.4g} Ah, as the slow test has it"
        raise ModelError("--pulses", f"{problem}: is one of them in mA?")


def _cell_model(
    fit: SurfaceFit, slow: SlowCurves, recordings: Sequence[Recording], capacity_ah: float, name: str, source: str
) -> CellModel:
    soc = np.linspace(0.0, 1.0, OCV_POINTS)
    ocv_v = np.interp(soc, SOC_GRID, fit.ocv_v)
    seen = seen_temperatures(recordings)
    # two energies that were measured hold beyond their temperatures as well as others of their kind
    energy_sigma = ACTIVATION_SIGMA_J_MOL if float(np.ptp(seen)) < SPAN_MIN_K else FIT_SIGMA_J_MOL
    return CellModel(
        name=name,
        source=source,
        capacity_ah=capacity_ah,
        ocv=OcvCurve(soc, np.maximum.accumulate(ocv_v) + 1e-7 * np.arange(OCV_POINTS)),
        surface=fit.surface,
        **fit.surface.tables(),
        v_min_v=round(float(slow.discharge_v.min()) * 20.0) / 20.0,
        v_max_v=round(float(slow.charge_v.max()) * 20.0) / 20.0,
        fit_temperature_degc=seen,
        activation_sigma_j_mol=energy_sigma,
    )


def _ocv_shift(fit: SurfaceFit, slow_degc: float) -> OcvShift:
    """Return what the OCV at a SOC and a temperature lies above that at the temperature of the slow tests."""
    surface = fit.surface

    def shift(soc: FloatArray, degc: FloatArray) -> FloatArray:
        measured_degc = np.where(np.isnan(degc), REFERENCE_DEGC, degc)
        v_k = np.interp(soc, surface.entropy_soc, surface.entropy_v_k)
        return np.asarray(v_k * (np.clip(measured_degc, surface.entropy_degc[0], surface.entropy_degc[1]) - slow_degc))

    return shift


def _evidence(
    fit: SurfaceFit, slow: SlowCurves, parts: Sequence[Part], fits: Sequence[PartFit], capacity_ah: float
) -> Evidence:
    soc = np.concatenate([part.soc for part in parts])
    degc = np.concatenate([part.recording.temperature_degc for part in parts])
    current_c = np.abs(np.concatenate([part.recording.current_a for part in parts])) / capacity_ah
    left_v = np.concatenate([fit.residual_v for fit in fits])
    is_judged = np.isfinite(left_v) & (soc >= JUDGED_SOC)

    def by(values: FloatArray, edges: FloatArray | None = None) -> tuple[tuple[float, float], ...]:
        bins = np.round(values / ERROR_STEP_K) if edges is None else np.searchsorted(edges, values, side="right")
        pairs = []
        for one in np.unique(bins[is_judged & np.isfinite(values)]):
            here = is_judged & (bins == one)
            rms_v = float(np.sqrt(np.mean(left_v[here] ** 2)))
            pairs.append((round(float(np.median(values[here])), 3), float(f"{rms_v:.3g}")))
        return tuple(pairs)

    loaded = is_judged & (current_c > REST_CURRENT_C)
    sigma = {of: fit.sigma[name] for name, of in SIGMA_OF.items()}
    for name, short in (("tau_s", "tau"), ("soc_per_a", "d"), ("r_ohm", "r")):
        of_lags = [fit.sigma[f"{short}{k}"] for k in range(len(fit.surface.lags))]
        if of_lags:
            sigma[name] = max(of_lags)
    return Evidence(
        lowest=lowest_soc(parts, capacity_ah),
        soc=(round(float(soc[loaded].min()), 3), round(float(soc[loaded].max()), 3)) if loaded.any() else (),
        sigma=tuple((name, float(f"{value:.3g}")) for name, value in sorted(sigma.items())),
        by_degc=by(degc),
        by_soc=by(soc, ERROR_SOC),
        by_c=by(current_c, ERROR_C),
        held=held_currents((part.recording.time_s, part.recording.seen_charge_ah) for part in parts),
    )


def lowest_soc(parts: Sequence[Part], capacity_ah: float) -> tuple[tuple[float, float], ...]:
    """Return temperatures [degC], rising, and the lowest SOC that a recording there, or colder, shows under load."""
    seen = []
    for part in parts:
        r = part.recording
        loaded = np.isfinite(part.soc) & np.isfinite(r.voltage_v) & (np.abs(r.current_a) > REST_CURRENT_C * capacity_ah)
        if loaded.any():
            degc = r.temperature_degc[loaded & np.isfinite(r.temperature_degc)]
            at = float(np.median(degc)) if degc.size else REFERENCE_DEGC
            seen.append((round(at, 1), round(float(part.soc[loaded].min()), 3)))
    pairs: list[tuple[float, float]] = []
    for at, low in sorted(seen):
        if not pairs or low < pairs[-1][1]:
            pairs.append((at, low))
    return tuple(pairs)


def seen_temperatures(recordings: Sequence[Recording]) -> FloatArray:
    """Return (m,) the temperatures that recordings tell of, rising, 5 K or less apart where they are continuous."""
    seen: list[float] = []
    for recording in recordings:
        degc = recording.temperature_degc[np.isfinite(recording.temperature_degc)]
        if degc.size == 0:
            seen.append(REFERENCE_DEGC)
            continue
        low, high = np.percentile(degc, (100.0 * SEEN_SHARE, 100.0 - 100.0 * SEEN_SHARE))
        seen += np.linspace(low, high, 1 + max(int(np.ceil((high - low) / SEEN_STEP_K)), 1)).tolist()
    return np.unique(np.round(seen, 1))


def typical_temperature(recordings: Sequence[Recording]) -> float:
    """Return the median temperature of recordings [degC]; 25 where none was recorded."""
    degc = np.concatenate([r.temperature_degc for r in recordings])
    return float(np.nanmedian(degc)) if np.isfinite(degc).any() else REFERENCE_DEGC


def _one_temperature(model: CellModel) -> str:
    assert model.surface is not None
    s = model.surface
    return (
        f"measured at {np.median(model.measured_degc):.0f} degC alone: what temperature does follows the usual "
        f"energies ({s.r0_j_mol / 1e3:.0f}, {s.kinetics_j_mol / 1e3:.0f} and {s.diffusion_j_mol / 1e3:.0f} kJ/mol), "
        f"+- {model.activation_sigma_j_mol / 1e3:.0f}"
    )


def next_test(learned: Mapping[str, float], has_slow_charge: bool) -> str | None:
    """Return which further test would show most of what is still as it usually is, None where all is known."""
    least = [(learned[name], text) for name, text in TESTS if name in learned]
    if not has_slow_charge:
        least.append((1.0, "a slow charge, C/20 or less: it shows where the OCV lies, and hysteresis"))
    share, text = max(least)
    return text if share > UNKNOWN else None


def open_loop_voltage(model: CellModel, part: Part) -> FloatArray:
    """Return the (n,) voltage of the model along a recording [V], from its SOC and rest; NaN where unknown."""
    r = part.recording
    temperature = np.where(np.isnan(r.temperature_degc), REFERENCE_DEGC, r.temperature_degc)
    branch = np.zeros((model.n_rc, r.time_s.size))
    for k, tau in enumerate(model.tau_s):
        branch[k] = branch_current(r.time_s, r.current_a, float(tau[0, 0]))
    return model.terminal_voltage(part.soc, branch, r.current_a, temperature)


def _part_fit(model: CellModel, part: Part) -> PartFit:
    r = part.recording
    residual_v = r.voltage_v - open_loop_voltage(model, part)
    judged = np.isfinite(residual_v) & (part.soc >= JUDGED_SOC)
    return PartFit(
        name=r.source,
        is_drive=part.is_drive,
        rows=len(r.time_s),
        voltage_rms_v=float(np.sqrt(np.mean(residual_v[judged] ** 2))) if judged.any() else float("nan"),
        current_max_a=float(np.abs(r.current_a).max()),
        soc_range=(float(np.nanmin(part.soc)), float(np.nanmax(part.soc))),
        temperature_range_degc=(float(r.temperature_degc.min()), float(r.temperature_degc.max())),
        soc=part.soc,
        residual_v=residual_v,
    )


def _warnings(fits: Sequence[PartFit], capacity_ah: float) -> list[str]:
    pulse_max = max((fit.current_max_a for fit in fits if not fit.is_drive), default=0.0)
    drive_max = max((fit.current_max_a for fit in fits if fit.is_drive), default=0.0)
    warnings = []
    if drive_max == 0.0:
        warnings.append(
            f"no drive given: above {pulse_max:.3g} A ({pulse_max / capacity_ah:.2g} C) the model has no evidence; "
            "race currents are usually higher: add a test day with --drive"
        )
    elif drive_max < RATED_C * capacity_ah:
        warnings.append(f"the drive stays below {drive_max:.3g} A: a harder race lies outside the data")
    for fit in fits:
        if fit.voltage_rms_v > VOLTAGE_RMS_LIMIT_V:
            warnings.append(f"{fit.name}: the model misses the voltage by {1e3 * fit.voltage_rms_v:.0f} mV RMS")
        low, high = fit.soc_range
        if low < -SOC_BEYOND or high > 1.0 + SOC_BEYOND:
            warnings.append(
                f"{fit.name}: runs from {100.0 * low:.0f} to {100.0 * high:.0f} % SOC: the slow test does not cover "
                "the cell, or the count is wrong"
            )
    return warnings


def _flat(slow: SlowCurves) -> list[str]:
    """Warn of a cell whose voltage hardly determines its SOC."""
    if not slow.is_flat:
        return []
    gap_v = float(np.median(slow.charge_v - slow.discharge_v))
    hysteresis = f", and charge and discharge lie {1e3 * gap_v:.0f} mV apart" if slow.has_charge else ""
    return [
        f"the OCV rises by less than {100.0 * FLAT_V:.0f} mV per 10 % of SOC over {100.0 * slow.flat_share:.0f} % of "
        "the range"
        f"{hysteresis}: there the SOC rests on counted charge, and a wrong start is corrected late"
    ]
