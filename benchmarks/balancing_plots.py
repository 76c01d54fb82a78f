"""Pictures of the balancing study. matplotlib is imported only when something is drawn."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from simulator.balancing.charge import BalancingRun

# Evenly spaced in lightness, distinct without colour vision.
COLOURS = ("#1f4e8c", "#c8621b", "#3f8f6b", "#8a4fa0", "#7a7a7a", "#b8a12e")


def figure_of(columns: int, width_in: float = 9.0, height_in: float = 3.4) -> tuple[Any, Any]:
    """Return a figure and its axes, one a column."""
    import matplotlib as mpl
    from matplotlib import pyplot

    mpl.use("svg")
    mpl.rcParams.update({"svg.hashsalt": "voltwall", "font.size": 8, "lines.linewidth": 1.2, "axes.linewidth": 0.6})
    mpl.rcParams.update({"axes.spines.top": False, "axes.spines.right": False})
    figure, axes = pyplot.subplots(1, columns, figsize=(width_in, height_in), layout="constrained", squeeze=False)
    return figure, axes[0]


def save(figure: Any, path: Path) -> None:
    """Write a figure and close it."""
    from matplotlib import pyplot

    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Date": None})
    pyplot.close(figure)


def charging(traces: dict[str, BalancingRun], path: Path) -> None:
    """Draw current and temperature over time at each ambient."""
    figure, (left, right) = figure_of(2)
    for colour, (name, result) in zip(COLOURS, traces.items(), strict=False):
        left.plot(result.time_h, result.current_a, color=colour)
        right.plot(result.time_h, result.temperature_degc.max(axis=1), color=colour, label=name)
    right.axhline(40.0, color="#7a7a7a", linewidth=0.6)
    right.text(0.02, 40.4, "supervisor's limit", color="#7a7a7a")
    left.set(xlabel="time [h]", ylabel="current [A]", title="1C charge: no chatter at any ambient")
    right.set(xlabel="time [h]", ylabel="hottest cell [degC]")
    right.legend(frameon=False, title="ambient")
    save(figure, path)


def passive(
    results: dict[tuple[float, int], BalancingRun],
    thesis: dict[float, dict[int, tuple[float, float, float]]],
    path: Path,
) -> None:
    """Draw time, temperature and difference over the resistor, ours as lines, the thesis's as dots."""
    figure, axes = figure_of(3, 11.0)
    for colour, (c_rate, published) in zip(COLOURS, thesis.items(), strict=False):
        ours = [(ohm, r) for (c, ohm), r in results.items() if c == c_rate and r.stopped_by is None]
        values = [(o, r.hours, r.max_degc, 100 * r.soc_difference) for o, r in ours]
        for column, axis in enumerate(axes):
            axis.plot([v[0] for v in values], [v[column + 1] for v in values], color=colour, label=f"{c_rate}C")
            axis.plot(list(published), [entry[column] for entry in published.values()], "o", color=colour, markersize=3)
    for axis, label in zip(axes, ("time [h]", "hottest cell [degC]", "final difference [% SOC]"), strict=True):
        axis.set(xlabel="bleed resistor [ohm]", ylabel=label)
    axes[0].set_yscale("log")
    axes[2].set_yscale("log")
    axes[1].axhline(40.0, color="#7a7a7a", linewidth=0.6)
    axes[0].legend(frameon=False, title="lines: ours, dots: thesis")
    save(figure, path)


def bleeding_cycle(result: BalancingRun, path: Path) -> None:
    """Draw the course of one charge: how far each cell is above the lowest, and the temperatures."""
    figure, (left, right) = figure_of(2)
    above = 100 * (result.soc - result.soc.min(axis=1, keepdims=True))
    for cell, colour in zip(range(6), COLOURS, strict=True):
        left.plot(result.time_h, above[:, cell], color=colour, label=f"cell {cell + 1}")
        right.plot(result.time_h, result.temperature_degc[:, cell], color=colour)
    left.set(xlabel="time [h]", ylabel="SOC above the lowest cell [%]", title="1C, 40 ohm")
    right.set(xlabel="time [h]", ylabel="temperature [degC]")
    left.legend(frameon=False)
    save(figure, path)


def transformer(
    results: dict[float, BalancingRun], thesis: dict[float, tuple[float, float, float]], path: Path
) -> None:
    """Draw time and temperature over the charging rate."""
    figure, axes = figure_of(2)
    rates = list(results)
    axes[0].plot(rates, [r.hours for r in results.values()], color=COLOURS[0], label="ours")
    axes[0].plot(list(thesis), [entry[0] for entry in thesis.values()], "o", color=COLOURS[1], label="thesis")
    axes[1].plot(rates, [r.max_degc for r in results.values()], color=COLOURS[0])
    axes[1].plot(list(thesis), [entry[1] for entry in thesis.values()], "o", color=COLOURS[1])
    axes[1].axhline(40.0, color="#7a7a7a", linewidth=0.6)
    axes[0].set(xlabel="rate [C]", ylabel="time [h]", yscale="log")
    axes[1].set(xlabel="rate [C]", ylabel="hottest cell [degC]")
    axes[0].legend(frameon=False)
    save(figure, path)


def capacitor(trials: dict[str, BalancingRun], sweep: list[tuple[float, float]], path: Path) -> None:
    """Draw how the trials drift apart, and the final difference over the transfer resistance."""
    figure, (left, right) = figure_of(2)
    for colour, (name, result) in zip(COLOURS, trials.items(), strict=False):
        left.plot(result.time_h, 100 * np.ptp(result.soc, axis=1), color=colour, label=name)
    left.set(xlabel="time [h]", ylabel="difference [% SOC]", yscale="log")
    left.legend(frameon=False)
    ohm, difference = np.array(sorted(sweep)).T
    right.plot(1e3 * ohm, difference, "o", color=COLOURS[0], markersize=3)
    right.axhline(0.1, color="#7a7a7a", linewidth=0.6)
    right.text(1e3 * ohm.min(), 0.105, "0.1 %: balanced", color="#7a7a7a")
    right.set(
        xlabel="resistance of the slowest pattern [mohm]",
        ylabel="difference after one 1C charge [% SOC]",
        xscale="log",
        yscale="log",
    )
    save(figure, path)


def accumulator(series: dict[str, tuple[list[float], list[float]]], path: Path) -> None:
    """Draw the difference over time for 96 cells."""
    figure, (axis,) = figure_of(1, 6.5)
    for colour, (name, (hours, difference)) in zip(COLOURS, series.items(), strict=False):
        axis.plot(hours, difference, color=colour, label=name)
    axis.set(xlabel="time [h]", ylabel="highest less lowest [% SOC]", ylim=(0.0, None))
    axis.legend(frameon=False)
    save(figure, path)
