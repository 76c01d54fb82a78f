"""`voltwall battery size`: what a battery of given cells can do, before it is built."""

import argparse
import json
import sys
from dataclasses import asdict

from app.battery.sizing import Figure, Layout, figures_of
from app.errors import ConfigError
from app.estimation.cell_model.cell_file import load_cell
from app.estimation.cell_model.circuit import CellModel
from app.estimation.errors import EstimatorError


def size(args: argparse.Namespace) -> int:
    """Print what a battery of these cells can do."""
    try:
        cell = load_cell(args.cell)
    except EstimatorError as error:
        print(f"voltwall battery: {error}", file=sys.stderr)
        return 2
    _check_temperature(cell, args.temperature)
    n_segments, n_in_series = args.segments
    layout = Layout(n_segments, n_in_series, args.parallel)
    figures = figures_of(cell, layout, args.soc / 100.0, args.temperature)
    if args.json:
        document = {
            "cell": {"name": cell.name, "source": cell.source},
            "layout": asdict(layout),
            "soc": args.soc / 100.0,
            "temperature_degc": args.temperature,
            "figures": {name: asdict(figure) for name, figure in figures.items()},
        }
        print(json.dumps(document, indent=2, allow_nan=False))
        return 0
    print(
        f"{cell.name}: {layout.n_segments} segments of {layout.n_in_series} in series, {layout.n_parallel} in parallel"
    )
    print(f"{'':36}{'cell':>9}{'segment':>10}{'battery':>10}")
    for figure in figures.values():
        print(_line(figure))
    return 0


def _line(figure: Figure) -> str:
    begin = f"{figure.title:30}{figure.unit:>6}"
    if figure.cell is None or figure.segment is None or figure.battery is None:
        return f"{begin}  not known: the cell file has no {', '.join(figure.missing)}"
    values = (f"{figure.cell:.4g}", f"{figure.segment:.4g}", f"{figure.battery:.4g}")
    return f"{begin}{values[0]:>9}{values[1]:>10}{values[2]:>10}  {figure.condition}"


def _check_temperature(cell: CellModel, degc: float) -> None:
    low, high = cell.limits.temperature_min_degc, cell.limits.temperature_max_degc
    low, high = -60.0 if low is None else low, 150.0 if high is None else high
    if not low <= degc <= high:
        raise ConfigError("temperature", degc, f"{low:g} to {high:g} degC, by the cell file")
