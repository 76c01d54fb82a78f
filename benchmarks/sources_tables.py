"""The SOC thesis's key data and load patterns next to the right numbers: `python -m benchmarks.sources_tables`.

Prints the first two tables of docs/contributing/theses.md and one of the units of the master's struct, computed from
the cell file, the layout and the patterns. With `--curves FILE` its table of 10 x 1001 voltages is written as CSV.
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from app.battery.sizing import CellLayout, figures_of
from app.estimation.cell_model.cell_file import load_cell
from benchmarks.sources_units import units
from benchmarks.thesis_curves import load_curves
from simulator.loads import PATTERNS_C

CELLS_A_MODULE = 10
PASSES, STEP_S = 113_605, 290e-6  # passes and step of the hard run, as the thesis reports them
PRINTED_MASS_KG = {"segment": 7.40, "battery": 59.2}  # by CAD, with electronics and mechanics: no equation gives them


def key_data() -> list[str]:
    """Return Tables 1 to 3 as they follow from one 25R cell, 10 in parallel, 12 in series, 8 packs."""
    figures = figures_of(load_cell("samsung-25r-10p"), CellLayout(8, 12))
    charge, highest = figures["capacity_ah"], figures["voltage_max_v"]
    energy, mass = figures["energy_nominal_mj"], figures["mass_kg"]
    lines = [
        "| | highest / nominal / lowest | capacity | energy, thesis | actual meaning | energy | mass of cells |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for which, title, part in (("cell", "cell", CELLS_A_MODULE), ("segment", "pack", 1), ("battery", "accumulator", 1)):
        volts = [getattr(figures[f"voltage_{name}_v"], which) for name in ("max", "nominal", "min")]
        ah = getattr(charge, which) / part
        wh = getattr(highest, which) * ah
        joule = 1e6 * getattr(energy, which) / part
        printed = f"{wh:.4g} kJ" if which == "cell" else f"{wh / 1e3:.4g} MJ"
        right = f"{joule / 1e3:.3g} kJ" if which == "cell" else f"{joule / 1e6:.3g} MJ"
        kg = getattr(mass, which) / part
        weighs = f"{1e3 * kg:.0f} g" if which == "cell" else f"{kg:.1f} kg of {PRINTED_MASS_KG[which]:g} kg"
        volts_text = " / ".join(f"{value:.4g}" for value in volts)
        lines.append(
            f"| {title} | {volts_text} V | {ah:g} Ah | {printed} | {wh:g} Wh at {volts[0]:.4g} V | {right} | {weighs} |"
        )
    return lines


def patterns() -> list[str]:
    """Return what each pattern of the thesis's menu sums to, how long its formula makes it and what it then draws."""
    lines = [
        "| pattern | slices | sum | 36,000 / sum | time increments, rounded up | drawn |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for name, load in PATTERNS_C.items():
        total, n = sum(load), len(load)
        tenths = 36_000 / total
        drawn = drawn_of(load, tenths / 10.0)
        lines.append(
            f"| {name} | {n} | {total:g} C | {tenths / 10:.1f} s | {math.ceil(tenths):,} | {100 * drawn:.2f} % |"
        )
    return lines


def drawn_of(load: tuple[float, ...], seconds: float) -> float:
    """Return the share of the charge that a pattern draws in so long a run, its slices equal."""
    return sum(load) / len(load) * seconds / 3600.0


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--curves", metavar="FILE", help="write the 10 x 1001 voltages over SOC [V]")
    if file := parser.parse_args().curves:
        columns = np.vstack((np.linspace(0.0, 1.0, 1001), load_curves())).T
        heads = ",".join(("soc", *(f"voltage_{c}c_v" for c in range(1, 11))))
        np.savetxt(file, columns, fmt="%.4f", delimiter=",", header=heads, comments="")
    print("\n".join(key_data()), "", *patterns(), "", *units(), "", sep="\n")
    seconds = PASSES * STEP_S
    drawn = 100.0 * drawn_of(PATTERNS_C["hard"], seconds)
    print(f"{PASSES:,} passes of 290 us are {seconds:.1f} s of the hard pattern and draw {drawn:.2f} %.")


if __name__ == "__main__":
    main()
