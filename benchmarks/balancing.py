"""The balancing study: the thesis's tables redone, and what comes after them.

`python -m benchmarks.balancing [PART ...]` prints its tables; docs/contributing/theses.md has the results. With
`--plots DIR` it draws its pictures (needs matplotlib). Parts: charging, passive, threshold, transformer, capacitor,
accumulator.
"""

from __future__ import annotations

import argparse
import itertools
import time
from pathlib import Path

import numpy as np

from benchmarks import balancing_plots as plots
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
from simulator.balancing.charge import BalancingRun, ChargePlan, Supervisor, charge, equalise
from simulator.balancing.circuits import SwitchedCapacitors
from simulator.balancing.six_cells import RATED_AH, six_cells
from simulator.balancing.switched_capacitor import SwitchedCapacitorParameters
from simulator.balancing.thesis_tables import THESIS_PASSIVE, THESIS_TRANSFORMER
from simulator.balancing.transformer import TransformerParameters

CELL_OHM = 0.0082
RESISTORS_OHM = (10, 20, 30, 40, 50, 60, 70, 80)
PASSIVE_C = (0.25, 0.5, 1.0, 2.0)
# those of the search for switched capacitors, and values between them that were tried besides
SWEEP_MICRO = (22.0, 100.0, 470.0, 1000.0, 4700.0)  # capacitors [uF]
SWEEP_KILO = (10.0, 50.0, 100.0)  # [kHz]
SWEEP_MILLI = (1.0, 3.0, 10.0, 100.0)  # switches [mohm]
SWEEP_BETWEEN = ((150.0, 100.0, 3.0), (200.0, 100.0, 3.0))
TRANSFORMER_C = (0.25, 0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)


def cells(**changes: object) -> Accumulator:
    """Return the thesis's six cells."""
    return Accumulator(six_cells(**changes), np.random.default_rng(0))  # type: ignore[arg-type]


def words(hours: float, degc: float, percent: float, stopped_by: str | None) -> str:
    """Return one table entry."""
    return f"{hours:.2f} / {degc:.1f} / {percent:.3f}" if stopped_by is None else f"{stopped_by} at {hours:.2f} h"


def entry(result: BalancingRun) -> str:
    """Return one table entry for a result."""
    return words(result.hours, result.max_degc, 100 * result.soc_difference, result.stopped_by)


def charging(folder: Path | None) -> None:
    """Charge at three ambients, to three top voltages, and discharge at three rates."""
    print("\n| ambient degC | ended by | h | highest degC | highest V | direction changes of the current |")
    print("|---|---|---|---|---|---|")
    traces = {}
    for ambient_degc in (0.5, 20.0, 40.0):
        result = charge(cells(ambient_degc=ambient_degc), NoBalancing(), ChargePlan(RATED_AH))
        rises = int((np.diff(result.current_a) > 1e-6).sum())
        stop = result.stopped_by or "end current"
        print(
            f"| {ambient_degc} | {stop} | {result.hours:.2f} | {result.max_degc:.1f} | {result.highest_v:.4f} |"
            f" {rises} |"
        )
        traces[f"{ambient_degc:g} degC"] = result
    print("\n| V_top | highest SOC % |\n|---|---|")
    for top_v in (4.2, 4.19, 4.1895):
        plan = ChargePlan(RATED_AH, top_v=top_v)
        result = charge(cells(start_soc=(0.201, *[0.2] * 5)), NoBalancing(), plan, Supervisor(max_v=4.25))
        print(f"| {top_v} | {100 * result.highest_soc:.3f} |")
    print("\n| discharge | h to 3.48 V | drawn Ah | mean V |\n|---|---|---|---|")
    for c_rate in (0.5, 1.0, 2.0):
        accumulator, seconds, energy_j = cells(start_soc=(0.9,) * 6), 0.0, 0.0
        while accumulator.terminal_voltage_v.min() > 3.48:
            accumulator.step(1.0, c_rate * RATED_AH)
            seconds += 1.0
            energy_j += accumulator.voltage_v / 6 * c_rate * RATED_AH
        drawn_ah = c_rate * RATED_AH * seconds / 3600
        print(f"| {c_rate}C | {seconds / 3600:.2f} | {drawn_ah:.2f} | {energy_j / 3600 / drawn_ah:.3f} |")
    if folder:
        plots.charging(traces, folder / "balancing-charging.svg")


def passive(folder: Path | None) -> None:
    """Redo the passive tables."""
    print("\n| ohm | " + " | ".join(f"{c}C ours | {c}C thesis" for c in PASSIVE_C) + " |")
    print("|---" * (1 + 2 * len(PASSIVE_C)) + "|")
    results: dict[tuple[float, int], BalancingRun] = {}
    for ohm in RESISTORS_OHM:
        row = []
        for c_rate in PASSIVE_C:
            result = charge(cells(bleed_ohm=float(ohm)), PassiveBalancing(), ChargePlan(c_rate * RATED_AH))
            results[c_rate, ohm] = result
            published = THESIS_PASSIVE[c_rate].get(ohm)
            row += [entry(result), words(*published, None) if published else "stopped"]
        print(f"| {ohm} | " + " | ".join(row) + " |")
    if folder:
        plots.passive(results, THESIS_PASSIVE, folder / "balancing-passive.svg")
        plots.bleeding_cycle(results[1.0, 40], folder / "balancing-course.svg")


def threshold(folder: Path | None) -> None:
    """Raise the bleeding threshold above the sag that bleeding itself makes."""
    print("\n| threshold mV | h | hottest degC | final difference % | burnt Wh |\n|---|---|---|---|---|")
    for difference_v in (1e-4, 5e-4, 1e-3, 2e-3, 5e-3):
        rule = PassiveBalancing(ThresholdBleeding(difference_v=difference_v))
        result = charge(cells(bleed_ohm=40.0), rule, ChargePlan(0.5 * RATED_AH))
        print(
            f"| {1e3 * difference_v:g} | {result.hours:.2f} | {result.max_degc:.1f} |"
            f" {100 * result.soc_difference:.3f} | {result.balancing_loss_wh:.2f} |"
        )


def transformer(folder: Path | None) -> None:
    """Redo the transformer table."""
    print("\n| rate | ours | thesis |\n|---|---|---|")
    results = {}
    for c_rate in TRANSFORMER_C:
        results[c_rate] = charge(cells(), TransformerBalancing(6), ChargePlan(c_rate * RATED_AH))
        published = THESIS_TRANSFORMER.get(c_rate)
        print(f"| {c_rate}C | {entry(results[c_rate])} | {words(*published, None) if published else 'stopped'} |")
    if folder:
        plots.transformer(results, THESIS_TRANSFORMER, folder / "balancing-transformer.svg")


def with_capacitors(values: SwitchedCapacitorParameters, **options: float) -> tuple[BalancingRun, SwitchedCapacitors]:
    """Charge the six cells at 1C with an equaliser."""
    accumulator = cells()
    circuit = SwitchedCapacitors(accumulator, values, heat_in_cells=options.get("heat_in_cells", 0.0))
    supervisor = Supervisor(max_degc=99.0, min_v=0.0)
    return charge(accumulator, AllOutputsOn(circuit), ChargePlan(RATED_AH), supervisor), circuit


def capacitor(folder: Path | None) -> None:
    """Redo the three trials, then search values that work."""
    print("\n| C F | switch ohm | start | transfer ohm | follows in s | h | final difference % | lowest mean SOC % |")
    print("|---|---|---|---|---|---|---|---|")
    trials = {}
    for farad, ohm, precharged in (
        (550.0, 10.0, False),
        (550.0, 0.001, False),
        (2265.3, 15.0, False),
        (550.0, 10.0, True),
        (550.0, 0.001, True),
    ):
        values = SwitchedCapacitorParameters(farad, ohm, 10.0, cell_ohm=CELL_OHM, precharged=precharged)
        result, circuit = with_capacitors(values)
        equaliser = circuit.equalisers[0]
        trials[f"{farad:g} F, {ohm:g} ohm{', charged first' if precharged else ''}"] = result
        print(
            f"| {farad:g} | {ohm:g} | {'charged' if precharged else 'empty'} | {equaliser.transfer_ohm():.3g} |"
            f" {equaliser.slowest_time_s():.3g} | {result.hours:.2f} | {100 * result.soc_difference:.3f} |"
            f" {100 * result.soc.mean(axis=1).min():.1f} |"
        )
    print(
        "\n| C uF | kHz | switch mohm | pair mohm | slowest pattern mohm | final difference % |\n"
        "|---|---|---|---|---|---|"
    )
    sweep = []
    for micro, kilo, milli in sorted({*itertools.product(SWEEP_MICRO, SWEEP_KILO, SWEEP_MILLI), *SWEEP_BETWEEN}):
        values = SwitchedCapacitorParameters(micro * 1e-6, milli * 1e-3, kilo * 1e3, cell_ohm=CELL_OHM)
        plan = ChargePlan(RATED_AH, dt_s=10.0, control_period_s=10.0)
        accumulator = cells()
        circuit = SwitchedCapacitors(accumulator, values)
        result = charge(accumulator, AllOutputsOn(circuit), plan)
        equaliser = circuit.equalisers[0]
        slowest_ohm = equaliser.slowest_pattern_ohm()
        sweep.append((slowest_ohm, 100 * result.soc_difference))
        if kilo == 100.0 and milli in (1.0, 3.0, 10.0):
            print(
                f"| {micro:g} | {kilo:g} | {milli:g} | {1e3 * equaliser.transfer_ohm():.1f} |"
                f" {1e3 * slowest_ohm:.0f} | {100 * result.soc_difference:.3f} |"
            )
    if folder:
        plots.capacitor(trials, sweep, folder / "balancing-capacitor.svg")


def accumulator_96(folder: Path | None) -> None:
    """Balance all 96 modules at rest by each method, from one start."""
    parts = {
        "passive 23.5 ohm": "96 MOSFETs, 192 resistors (in the slaves already)",
        "transformer per pack": "8 transformers of 14 windings, 96 MOSFETs, 16 diodes",
        "capacitors per pack": "88 capacitor banks, 192 MOSFETs",
        "capacitors, one chain": "95 capacitor banks, 192 MOSFETs",
    }
    print(
        "\n| method | h | difference % | within packs % | hottest cell degC | board degC | loss Wh | SOC given up % |"
        " parts |"
    )
    print("|---" * 9 + "|")
    series: dict[str, tuple[list[float], list[float]]] = {}
    strong = SwitchedCapacitorParameters(10e-3, 0.5e-3, 100e3, cell_ohm=1.6e-3)
    forward = TransformerParameters(switch_ohm=0.03, primary_ohm=0.01, secondary_ohm=0.2)
    for name, text in parts.items():
        pack = Accumulator(AccumulatorParameters(start_soc=0.9, start_soc_spread=0.006), np.random.default_rng(7))
        balancers: dict[str, Balancer] = {
            "passive 23.5 ohm": SocBleeding(1e-3, measured_share=0.023),
            "transformer per pack": TransformerBalancing(96, forward, group=12, soc_difference=2e-3),
            "capacitors per pack": AllOutputsOn(SwitchedCapacitors(pack, strong, group=12)),
            "capacitors, one chain": AllOutputsOn(SwitchedCapacitors(pack, strong)),
        }
        hours, difference, loss_wh, hottest, board = [0.0], [spread(pack)], 0.0, 0.0, 0.0
        start_soc, slices = float(pack.soc.mean()), 24
        for _ in range(slices):
            done = equalise(pack, balancers[name], difference=3e-3, period_s=10.0, time_limit_s=1800.0)
            hours.append(hours[-1] + done.hours)
            difference.append(spread(pack))
            loss_wh += done.balancing_loss_wh
            hottest, board = max(hottest, done.max_degc), max(board, done.max_board_degc)
        inside = max(100 * float(np.ptp(pack.soc[first : first + 12])) for first in range(0, 96, 12))
        print(
            f"| {name} | {hours[-1]:.1f} | {difference[-1]:.2f} | {inside:.2f} | {hottest:.1f} | {board:.1f} |"
            f" {loss_wh:.1f} | {100 * (start_soc - float(pack.soc.mean())):.2f} | {text} |"
        )
        series[name] = (hours, difference)
    if folder:
        plots.accumulator(series, folder / "balancing-accumulator.svg")


def spread(pack: Accumulator) -> float:
    """Return highest less lowest SOC [%]."""
    return 100 * float(np.ptp(pack.soc))


PARTS = {
    "charging": charging,
    "passive": passive,
    "threshold": threshold,
    "transformer": transformer,
    "capacitor": capacitor,
    "accumulator": accumulator_96,
}


def main() -> None:
    """Run the parts named, all by default."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", default=list(PARTS), metavar="PART", help=f"of {', '.join(PARTS)}")
    parser.add_argument("--plots", type=Path, help="folder for the pictures")
    options = parser.parse_args()
    for name in options.parts:
        if name not in PARTS:
            parser.error(f"no part {name!r}")
        began = time.process_time()
        PARTS[name](options.plots)
        print(f"\n({name}: {time.process_time() - began:.1f} s of processor time)")


if __name__ == "__main__":
    main()
