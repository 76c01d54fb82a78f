"""A charge or a rest of chosen cells with each balancing circuit: `voltwall balance`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

import numpy as np

from simulator.accumulator import Accumulator, AccumulatorParameters
from simulator.balancing.balancers import (
    AllOutputsOn,
    Balancer,
    NoBalancing,
    PassiveBalancing,
    SocBleeding,
    ThresholdBleeding,
    TransformerBalancing,
)
from simulator.balancing.charge import (
    SECONDS_PER_HOUR,
    BalancingRun,
    ChargePlan,
    OnProgress,
    Supervisor,
    charge,
    equalise,
)
from simulator.balancing.choices import CIRCUITS, LIMITS
from simulator.balancing.circuits import STRONG_CAPACITORS, STRONG_TRANSFORMER, SwitchedCapacitors
from simulator.balancing.six_cells import RATED_AH, START_SOC, six_cells
from simulator.balancing.switched_capacitor import SwitchedCapacitorParameters
from simulator.balancing.thesis_tables import THESIS_PASSIVE, THESIS_TRANSFORMER
from simulator.cell_data import FloatArray
from simulator.errors import ParameterError

MOST_CELLS: Final = 600
# A charge of the thesis's cells that 200 uF, 3 mohm and 100 kHz balance
_SMALL_CAPACITORS = SwitchedCapacitorParameters(200e-6, 3e-3, 100e3, cell_ohm=0.0082)


@dataclass(frozen=True)
class Study:
    """A charge or a rest to study.

    Attributes:
        cells: `thesis`, six cells of the balancing thesis, or `car`, the modules of the team's car.
        n_packs: packs in series; transformers and capacitors work inside each.
        per_pack: cells in series in each pack.
        rate_c: charging current over the rated capacity [1/h]; None: a rest.
        hours: after which it ends at the latest [h].
        soc: mean state of charge at the start, 0..1.
        spread: highest less lowest SOC at the start, 0..1.
        ambient_degc: of the air, and of the cells at the start [degC].
        resistor_ohm: of the bleed resistors [ohm].
        threshold_v: above the lowest voltage by which a cell bleeds while it charges [V].
        until: a rest ends when the SOCs differ by less, 0..1.
        seed: which cell gets which SOC, capacity and resistance.
    """

    cells: Literal["thesis", "car"] = "car"
    n_packs: int = 8
    per_pack: int = 12
    rate_c: float | None = 0.5
    hours: float = 24.0
    soc: float = 0.2
    spread: float = 0.02
    ambient_degc: float = 25.0
    resistor_ohm: float = 23.5
    threshold_v: float = 1e-3
    until: float = 3e-3
    seed: int = 1

    def __post_init__(self) -> None:
        for name, (low, high) in LIMITS.items():
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                raise ParameterError(name, value, f"{low:g} to {high:g}")
        if min(self.n_packs, self.per_pack) < 1 or self.n_cells > MOST_CELLS:
            raise ParameterError("n_packs x per_pack", self.n_cells, f"1 to {MOST_CELLS} cells")
        if not 0.0 <= self.soc - self.spread / 2 <= self.soc + self.spread / 2 <= 1.0:
            raise ParameterError("spread", self.spread, f"no cell below SOC 0 or above 1, around {self.soc:g}")

    @property
    def rated_ah(self) -> float:
        """Capacity that 1C refers to [Ah]."""
        return RATED_AH if self.cells == "thesis" else AccumulatorParameters().cell.capacity_ah

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return self.n_packs * self.per_pack

    @property
    def is_of_thesis(self) -> bool:
        """Return whether the thesis charged just these cells, at some rate and with some resistors."""
        return replace(self, rate_c=THESIS.rate_c, resistor_ohm=THESIS.resistor_ohm) == THESIS

    @property
    def start_soc(self) -> FloatArray:
        """(n_cells,) evenly between the lowest and the highest, in an order by chance; the thesis's own in its case."""
        if self.is_of_thesis:
            return np.array(START_SOC)
        offsets = np.linspace(-0.5, 0.5, self.n_cells) if self.n_cells > 1 else np.zeros(1)
        return np.asarray(self.soc + self.spread * np.random.default_rng(self.seed).permutation(offsets))

    def accumulator(self) -> Accumulator:
        """Return the cells as they are at the start."""
        soc = self.start_soc
        if self.cells == "thesis":
            built = six_cells(
                ambient_degc=self.ambient_degc, start_soc=tuple(soc.tolist()), bleed_ohm=self.resistor_ohm
            )
            start_degc = built.start_degc if self.is_of_thesis else self.ambient_degc
            built = replace(built, cells_per_pack=self.per_pack, start_degc=start_degc)
        else:
            built = AccumulatorParameters(
                n_cells=self.n_cells,
                cells_per_pack=self.per_pack,
                start_soc=soc,
                start_soc_spread=0.0,
                ambient_degc=self.ambient_degc,
                bleed_ohm=self.resistor_ohm,
            )
        return Accumulator(built, np.random.default_rng(self.seed))


THESIS: Final = Study(
    cells="thesis",
    n_packs=1,
    per_pack=len(START_SOC),
    rate_c=0.5,
    soc=0.205,
    spread=0.01,
    ambient_degc=23.0,
    resistor_ohm=40.0,
    threshold_v=1e-4,
    until=1e-3,
)


def study_of(*, thesis: bool, rest: bool, packs: tuple[int, int] | None, **values: float | None) -> Study:
    """Return a charge or a rest; what is None is as in the study of the car, or of the thesis.

    Args:
        thesis: the six cells of the balancing thesis, not the car's.
        rest: no charge.
        packs: number in series, and cells in series in each.
        values: of other fields of a `Study`.

    Raises:
        ParameterError: a value is out of its limits.
    """
    study = THESIS if thesis else Study()
    if rest:
        study = replace(study, rate_c=None, soc=study.soc if thesis else 0.9)
    if packs is not None:
        study = replace(study, n_packs=packs[0], per_pack=packs[1])
    chosen: dict[str, Any] = {name: value for name, value in values.items() if value is not None}
    return replace(study, **chosen)


def run_study(study: Study, circuit: str, on_progress: OnProgress = lambda done, of: None) -> BalancingRun:
    """Charge or rest with a circuit of `CIRCUITS`.

    Bleed resistors follow the measured voltages while it charges; at rest, and with transformers, the cell to drive is
    chosen by its true SOC, which no master knows as well. `on_progress` is called with how far it is.
    """
    accumulator = study.accumulator()
    balancer = _balancer(study, circuit, accumulator)
    limit_s = study.hours * SECONDS_PER_HOUR
    if study.rate_c is None:
        return equalise(accumulator, balancer, difference=study.until, time_limit_s=limit_s, on_progress=on_progress)
    if study.cells == "thesis":
        plan = ChargePlan(study.rate_c * RATED_AH, time_limit_s=limit_s)
        return charge(accumulator, balancer, plan, on_progress=on_progress)
    plan = ChargePlan(
        study.rate_c * study.rated_ah,
        end_a=0.02 * study.rated_ah,
        loop_ohm=0.005,
        time_limit_s=limit_s,
    )
    return charge(accumulator, balancer, plan, Supervisor(min_degc=-20.0, max_degc=60.0), on_progress)


def difference_within_packs(study: Study, run: BalancingRun) -> float:
    """Return the largest difference of SOC at the end between two cells of one pack, 0..1."""
    return float(np.ptp(run.soc[-1].reshape(study.n_packs, study.per_pack), axis=1).max())


def thesis_figures(study: Study, circuit: str) -> tuple[float, float, float] | None:
    """Return hours, highest temperature [degC] and final difference [%] that the thesis has for it; None without."""
    if not study.is_of_thesis or study.rate_c is None:
        return None
    if circuit == "passive":
        return THESIS_PASSIVE.get(study.rate_c, {}).get(round(study.resistor_ohm))
    return THESIS_TRANSFORMER.get(study.rate_c) if circuit == "transformer" else None


def figures_of_circuits(study: Study, circuits: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return the figures and the course of each circuit, by its name."""
    return {circuit: figures_of(study, circuit, run_study(study, circuit)) for circuit in circuits}


def figures_of(study: Study, circuit: str, run: BalancingRun) -> dict[str, Any]:
    """Return the figures and the course of a run as JSON has them."""
    thesis = thesis_figures(study, circuit)
    return {
        "hours": run.hours,
        "max_degc": run.max_degc,
        "max_board_degc": run.max_board_degc,
        "soc_difference": run.soc_difference,
        "soc_difference_within_packs": difference_within_packs(study, run),
        "balancing_loss_wh": run.balancing_loss_wh,
        "charger_wh": run.charger_wh,
        "stopped_by": run.stopped_by,
        "thesis": thesis and dict(zip(("hours", "max_degc", "soc_difference_percent"), thesis, strict=True)),
        "course": {
            "time_h": run.time_h.tolist(),
            "soc_min": run.soc.min(axis=1).tolist(),
            "soc_max": run.soc.max(axis=1).tolist(),
            "voltage_max_v": run.voltage_v.max(axis=1).tolist(),
            "temperature_max_degc": run.temperature_degc.max(axis=1).tolist(),
            "charger_a": run.current_a.tolist(),
        },
    }


def _balancer(study: Study, circuit: str, accumulator: Accumulator) -> Balancer:
    is_thesis, group = study.cells == "thesis", study.per_pack
    match circuit:
        case "none":
            return NoBalancing()
        case "passive" if study.rate_c is None:
            return SocBleeding(study.until / 2)
        case "passive":
            return PassiveBalancing(ThresholdBleeding(difference_v=study.threshold_v))
        case "transformer":
            parameters = None if is_thesis else STRONG_TRANSFORMER
            return TransformerBalancing(
                study.n_cells, parameters, group=group, soc_difference=1e-3 if is_thesis else 2e-3
            )
        case "switched-capacitor":
            values = _SMALL_CAPACITORS if is_thesis else STRONG_CAPACITORS
            return AllOutputsOn(SwitchedCapacitors(accumulator, values, group=group))
    raise ParameterError("circuit", circuit, f"one of {', '.join(CIRCUITS)}")
