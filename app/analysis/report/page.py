"""The report of a session as one HTML file with its charts inside: to read, to print, to keep."""

from __future__ import annotations

from html import escape

import numpy as np

from app.analysis.black_box.excerpt import place, short_place
from app.analysis.printed.sheet import figure, quantity, sheet, table, utc
from app.analysis.printed.svg import AMBER, SOFT, TEAL, VIOLET, Band, Bars, Line, Mark, Rule, chart
from app.analysis.report.report import Report
from app.analysis.survey import Histogram
from app.battery.shape import CELLS_PER_PACK
from app.estimation.arrays import FloatArray

_HISTOGRAMS = {
    "current": ("Time at each current", "A", 1.0),
    "temperature": ("Cells' time at each temperature", "\u00b0C", 1.0),
    "soc": ("Cells' time at each state of charge", "%", 100.0),
}
_MOST_LAPS = 60


def report_page(report: Report) -> str:
    """Return the whole document."""
    info = report.info
    name = info.name or info.id
    body = [
        f"<h1>{escape(name)}</h1>",
        f'<p class="soft">{utc(info.started_wall_ns / 1e9)}, session {escape(info.id)}</p>',
        f'<p class="lead">{escape(report.headline)}</p>',
        *(["<section><h2>Why</h2>", _list(report.why), "</section>"] if report.why else []),
        "<section><h2>What limited</h2>",
        _list(report.limited),
        "</section><section><h2>What to look at</h2>",
        _list(report.look_at),
        "</section>",
        *_charts(report),
        *_histograms(report.survey.histograms),
        *_laps(report),
        "<section><h2>How near each limit came</h2>",
        table(
            ("limit", "seen", "allowed", "margin", "where"),
            [
                (
                    each.name,
                    quantity(each.seen, 3 if each.unit == "V" else 1, each.unit),
                    quantity(each.allowed, 3 if each.unit == "V" else 1, each.unit),
                    quantity(each.margin, 3 if each.unit == "V" else 1, each.unit.replace("degC", "K")),
                    place(each.cell),
                )
                for each in report.margins
            ],
            (1, 2, 3),
        ),
        "</section><section><h2>Resistance of every cell with its joint, in milliohms (row: pack, column: cell)</h2>",
        _cells(report.survey.resistance_ohm * 1000.0, 2),
        "</section><section><h2>Lowest voltage of every cell, in volts</h2>",
        _cells(report.survey.voltage_min_v, 3),
        "</section>",
    ]
    config = report.config_hash or "not heard"
    return sheet(f"Report of {name}", body, f"Voltwall {info.voltwall} · session {info.id} · configuration {config}")


def _list(sentences: list[str]) -> str:
    return "<ul>" + "".join(f"<li>{escape(sentence)}</li>" for sentence in sentences) + "</ul>"


def _charts(report: Report) -> list[str]:
    totals = report.totals
    if not totals.time_s.size:
        return []
    minutes = (totals.time_s - totals.time_s[0]) / 60.0
    marks = [
        Mark("", (each.lap.start_s - totals.time_s[0]) / 60.0, "#b9c2c6") for each in report.laps.laps[: _MOST_LAPS * 2]
    ]
    limits = report.limits
    cells = [Band("cells", minutes, totals.v_min_v, totals.v_max_v, TEAL)]
    low = [Rule("lowest allowed", limits["v_cell_min"])] if "v_cell_min" in limits else []
    hot = [Rule("highest allowed", limits["t_cell_max"])] if "t_cell_max" in limits else []
    heat = [Line("hottest", minutes, totals.t_max_degc, AMBER), Line("mean", minutes, totals.t_mean_degc, SOFT)]
    power = [Line("", minutes, totals.power_w / 1000.0, AMBER, 0.8)]
    soc = [Line("", minutes, totals.soc * 100.0, VIOLET)]
    return [
        figure("Power", chart("kW", power, marks=marks, height=120, x_unit="min", include=[0], name="Power")),
        figure(
            "Cell voltage, lowest to highest",
            chart("V", bands=cells, rules=low, marks=marks, height=130, x_unit="min", name="Cell voltage"),
        ),
        figure("State of charge, mean", chart("%", soc, marks=marks, height=90, x_unit="min", name="State of charge")),
        figure("Temperature", chart("\u00b0C", heat, rules=hot, marks=marks, height=110, x_unit="min", name="Heat")),
    ]


def _histograms(found: dict[str, Histogram]) -> list[str]:
    drawn = []
    for key, (name, unit, factor) in _HISTOGRAMS.items():
        histogram = found[key]
        filled = np.flatnonzero(histogram.seconds)
        if not filled.size:
            continue
        low, high = int(filled[0]), int(filled[-1]) + 1
        share = 100.0 * histogram.seconds[low:high] / histogram.seconds.sum()
        bars = Bars(histogram.edges[low : high + 1] * factor, share)
        drawn.append(figure(name, chart("%", bars=[bars], x_unit=unit, height=90, include=[0], name=name)))
    return drawn


def _laps(report: Report) -> list[str]:
    laps, drivers = report.laps.laps, report.laps.drivers
    if not laps:
        return []
    rows = [
        (
            str(number),
            quantity(each.lap.duration_s, 1, "s"),
            quantity(each.energy_out_wh, 0, "Wh"),
            quantity(each.energy_in_wh, 0, "Wh"),
            _kw(each.power_mean_w),
            _kw(each.power_max_w),
            "\u2013" if each.soc_used is None else quantity(100 * each.soc_used, 2, "%"),
            quantity(each.temperature_rise_k, 0, "K"),
            "\u2013" if each.weakest_cell is None else short_place(each.weakest_cell),
            quantity(each.voltage_min_v, 3, "V"),
            each.lap.driver,
        )
        for number, each in enumerate(laps[:_MOST_LAPS], 1)
    ]
    head = ("lap", "time", "out", "in", "mean", "peak", "charge", "warmer", "lowest cell", "at", "driver")
    found = [f"<h2>Laps, found by {report.laps.source}</h2>", table(head, rows, range(10))]
    if len(laps) > _MOST_LAPS:
        found.append(f'<p class="soft">The first {_MOST_LAPS} of {len(laps)}.</p>')
    if len(drivers) > 1:
        found += [
            "<section><h2>Drivers</h2>",
            table(
                ("driver", "laps", "mean", "best", "out a lap", "in a lap", "mean power"),
                [
                    (
                        one.driver or "not named",
                        str(one.laps),
                        quantity(one.lap_s, 2, "s"),
                        quantity(one.best_lap_s, 2, "s"),
                        quantity(one.energy_out_wh, 0, "Wh"),
                        quantity(one.energy_in_wh, 0, "Wh"),
                        _kw(one.power_mean_w),
                    )
                    for one in drivers
                ],
                range(1, 7),
            ),
            "</section>",
        ]
    return found


def _kw(watts: float | None) -> str:
    return quantity(None if watts is None else watts / 1000.0, 1, "kW")


def _cells(values: FloatArray, decimals: int) -> str:
    known = values[np.isfinite(values)]
    if not known.size:
        return "<p>Not known: too little current flowed.</p>"
    low, span = float(known.min()), float(np.ptp(known)) or 1.0
    rows = ["<tr><th></th>" + "".join(f"<th>{k + 1}</th>" for k in range(CELLS_PER_PACK)) + "</tr>"]
    for pack, row in enumerate(values.reshape(-1, CELLS_PER_PACK)):
        shown = [
            f'<td style="background:hsl(189 30% {96 - 30 * (value - low) / span:.0f}%)">{value:.{decimals}f}</td>'
            if np.isfinite(value)
            else "<td>\u2013</td>"
            for value in row.tolist()
        ]
        rows.append(f"<tr><th>{pack + 1}</th>{''.join(shown)}</tr>")
    return f'<table class="cells">{"".join(rows)}</table>'
