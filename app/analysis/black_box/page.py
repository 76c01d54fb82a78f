"""A black box as one page to print: what an electronics lead hands to a judge."""

from __future__ import annotations

from html import escape
from typing import Any

import numpy as np

from app.analysis.black_box.excerpt import place
from app.analysis.printed.sheet import facts, figure, quantity, sheet, signed, table, utc
from app.analysis.printed.svg import AMBER, SOFT, TEAL, Band, Line, Mark, Rule, chart
from app.battery.shape import CELLS_PER_PACK

_DECIMALS = {"V": 4, "A": 1, "degC": 0, "mohm": 2}
_LIMITS = {
    "v_cell_min": ("Lowest cell voltage allowed", 3, "V"),
    "v_cell_max": ("Highest cell voltage allowed", 3, "V"),
    "t_cell_min": ("Lowest temperature allowed", 0, "degC"),
    "t_cell_max": ("Highest temperature allowed", 0, "degC"),
    "i_disc_max": ("Highest current allowed", 0, "A"),
    "i_disc_min": ("Strongest charge current allowed", 0, "A"),
}


def blackbox_page(box: dict[str, Any]) -> str:
    """Return the page of a black box, as `app.analysis.black_box.excerpt.build` makes it."""
    where = place(box["cell"])
    beyond = box["beyond"] or {}
    opened = box["cells"]["opened_s"]
    decimals, unit = _DECIMALS.get(box["unit"], 2), box["unit"]
    rows = [
        ("When", utc(box["at"], milliseconds=True)),
        ("Where", where or "accumulator"),
        ("Value", quantity(box["value"], decimals, unit) if box["value"] is not None else ""),
        ("Limit", quantity(box["limit"], decimals, unit) if box["limit"] is not None else ""),
        ("Worst value", quantity(beyond["worst"], decimals, unit) if beyond else ""),
        ("Beyond the limit", quantity(beyond.get("lasted_s"), 2, "s") if beyond.get("lasted_s") is not None else ""),
        ("Beyond before the trip", quantity(-beyond["since_s"], 2, "s") if beyond.get("since_s") is not None else ""),
        ("Current at the trip", quantity(box["cells"]["current_at_trip_a"], 1, "A")),
        ("Shutdown circuit seen open", "" if opened is None else f"{signed(opened, 2, 's')} from the trip"),
        ("Samples", f"{len(box['samples']['time_s'])} at {box['rate_hz'] or 0:g} Hz"),
        *((name, quantity(box["limits"].get(key), places, of)) for key, (name, places, of) in _LIMITS.items()),
    ]
    body = [
        f"<h1>{escape(_title(box, where))}</h1>",
        f'<p class="soft">Black box {escape(box["id"])}</p>',
        f'<p class="lead">{escape(" ".join(box["summary"]))}</p>',
        facts(rows),
        *_charts(box),
        "<section><h2>All cells at the trip, in volts (row: pack, column: cell)</h2>",
        _map(box) + "</section>",
        "<section><h2>What was reported</h2>",
        table(("from the trip", "", "code", "text"), [_event_row(each) for each in box["events"]], (0,)) + "</section>",
        '<div class="sign"><div>Date and place</div><div>Electronics lead</div><div>Judge</div></div>',
    ]
    session = f"session {box['session_id']}" if box["session_id"] else "no recording"
    footer = f"Voltwall · {session} · configuration {box['config_hash'] or 'not heard'} · black box {box['id']}"
    return sheet(f"Black box {box['id']}", body, footer)


def _title(box: dict[str, Any], where: str) -> str:
    text = box["text"][:1].upper() + box["text"][1:]
    return text if not where or where in text else f"{text}: {where}"


def _event_row(event: dict[str, Any]) -> tuple[str, str, str, str]:
    return signed(event["t_s"], 2, "s"), event["severity"], event["code"], event["text"]


def _charts(box: dict[str, Any]) -> list[str]:
    samples = box["samples"]
    time_s = np.array(samples["time_s"], dtype=np.float64)
    if not time_s.size:
        return ["<p>No samples were received around this time.</p>"]
    marks = [Mark("", 0.0)]
    heat = box["quantity"] == "temperature"
    shown = "temperature_degc" if heat else "voltage_v"
    values = np.array(samples[shown], dtype=np.float64)
    cell = box["cell"]
    others = np.delete(values, cell, axis=0) if cell is not None else values
    band = Band("other cells" if cell is not None else "all cells", time_s, *_extremes(others))
    lines = (
        []
        if cell is None
        else [Line(f"{cell // CELLS_PER_PACK + 1}/{cell % CELLS_PER_PACK + 1}", time_s, values[cell])]
    )
    rules = []
    if box["quantity"] in ("voltage", "temperature") and box["limit"] is not None:
        rules = [Rule("limit", box["limit"])]
    name = "Cell temperature" if heat else "Cell voltage"
    unit = "\u00b0C" if heat else "V"
    charts = [figure(name, chart(unit, lines, bands=[band], rules=rules, marks=marks, height=150, name=name))]
    current = np.array(samples["current_a"], dtype=np.float64)
    rules = [Rule("limit", box["limit"])] if box["quantity"] == "current" and box["limit"] is not None else []
    line = Line("", time_s, current, AMBER)
    charts.append(
        figure("Current", chart("A", [line], rules=rules, marks=marks, height=92, include=[0], name="Current"))
    )
    circuit = [
        Line("shutdown circuit", time_s, np.array(samples["fit"], dtype=np.float64), TEAL),
        Line("relays", time_s, np.array(samples["load"], dtype=np.float64) * 0.9, SOFT),
    ]
    if any(np.isfinite(each.y).any() for each in circuit):
        charts.append(
            figure("Closed (1) or open (0)", chart("", circuit, marks=marks, height=58, include=[0, 1], name="Relays"))
        )
    return charts


def _extremes(values: np.ndarray[Any, Any]) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    return np.fmin.reduce(values, axis=0), np.fmax.reduce(values, axis=0)


def _map(box: dict[str, Any]) -> str:
    """All cells at the trip: shaded by where they lie between the lowest and the highest of the others."""
    values = np.array(box["cells"]["voltage_at_v"], dtype=np.float64)
    others = np.delete(values, box["cell"]) if box["cell"] is not None else values
    known = others[np.isfinite(others)]
    if not known.size:
        return "<p>No cell voltages were received.</p>"
    low, span = float(known.min()), float(np.ptp(known)) or 1.0
    rows = ["<tr><th></th>" + "".join(f"<th>{k + 1}</th>" for k in range(CELLS_PER_PACK)) + "</tr>"]
    for pack, row in enumerate(values.reshape(-1, CELLS_PER_PACK)):
        cells = []
        for k, value in enumerate(row):
            share = float(np.clip((value - low) / span, 0.0, 1.0)) if np.isfinite(value) else 0.0
            lightness = 62 + 34 * share
            out = ' class="out"' if pack * CELLS_PER_PACK + k == box["cell"] else ""
            text = f"{value:.3f}" if np.isfinite(value) else "\u2013"
            cells.append(f'<td{out} style="background:hsl(189 30% {lightness:.0f}%)">{text}</td>')
        rows.append(f"<tr><th>{pack + 1}</th>{''.join(cells)}</tr>")
    return f'<table class="cells">{"".join(rows)}</table>'
