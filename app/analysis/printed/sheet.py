"""The sheet that what is printed stands on: one HTML file without anything from outside, A4 when printed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from html import escape

MINUS = "\u2212"
_UNITS = {"degC": "\u00b0C", "ohm": "\u03a9", "mohm": "m\u03a9"}
_STYLE = """
:root { color-scheme: light }
* { box-sizing: border-box }
body { margin: 0 auto; max-width: 794px; padding: 32px 36px; background: #fff; color: #14181a;
  font: 13px/1.45 'IBM Plex Sans', system-ui, 'Segoe UI', Helvetica, Arial, sans-serif;
  font-variant-numeric: tabular-nums }
h1 { font-size: 21px; line-height: 1.25; margin: 0 0 2px; font-weight: 600; letter-spacing: -0.01em }
h2 { font-size: 13px; margin: 18px 0 4px; font-weight: 600; color: #465057; break-after: avoid }
p { margin: 0 0 6px; max-width: 72ch }
ul { margin: 0 0 6px; padding-left: 18px }
.soft { color: #5d676e }
.lead { font-size: 15px }
table { border-collapse: collapse; width: 100% }
th { text-align: left; font-weight: 400; color: #5d676e; white-space: nowrap }
th, td { padding: 2px 12px 2px 0; border-bottom: 1px solid #d2d7d9; vertical-align: baseline }
.num { text-align: right }
.facts { columns: 2; column-gap: 28px }
.facts div { display: flex; justify-content: space-between; gap: 12px; border-bottom: 1px solid #d2d7d9;
  padding: 2px 0; break-inside: avoid }
.facts dt { color: #5d676e } .facts dd { margin: 0; text-align: right }
dl { margin: 0 }
svg { display: block; width: 100%; height: auto;
  font: 10.5px/1 'IBM Plex Sans', system-ui, Helvetica, Arial, sans-serif }
figure { margin: 8px 0 0; break-inside: avoid }
figcaption { color: #465057; font-weight: 500 }
section { break-inside: avoid }
.cells { table-layout: fixed; font-size: 11px; text-align: center }
.cells td, .cells th { padding: 2px 0; border: 1px solid #fff; text-align: center }
.cells .out { outline: 2px solid #c01921; outline-offset: -2px; font-weight: 700 }
.sign { display: flex; gap: 36px; margin-top: 28px }
.sign div { flex: 1; border-top: 1px solid #14181a; padding-top: 3px }
footer { margin-top: 18px; color: #5d676e; font-size: 11px; overflow-wrap: anywhere }
@page { size: A4; margin: 12mm }
@media print {
  body { padding: 0; max-width: none; font-size: 10.5px; line-height: 1.35 }
  h2 { margin-top: 9px } figure { margin-top: 5px } footer { margin-top: 8px; font-size: 9.5px }
  .lead { font-size: 11.5px }
  .cells { font-size: 9.5px } .cells td, .cells th { padding: 1px 0 } .sign { margin-top: 30px }
  th, td { padding: 1px 10px 1px 0 }
}
"""


def sheet(title: str, body: Iterable[str], footer: str = "") -> str:
    """Return a whole HTML document."""
    return (
        "<!doctype html>\n"
        f'<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<style>{_STYLE}</style></head><body>\n{chr(10).join(body)}\n"
        f"<footer>{escape(footer)}</footer></body></html>\n"
    )


def facts(rows: Iterable[tuple[str, str]]) -> str:
    """Return names with their values in two columns; what is empty is left out."""
    shown = [f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in rows if value]
    return f'<dl class="facts">{"".join(shown)}</dl>'


def table(head: Sequence[str], rows: Iterable[Sequence[str]], numbers: Sequence[int] = ()) -> str:
    """Return a table; `numbers` are the columns that stand right."""

    def row(tag: str, cells: Sequence[str]) -> str:
        right = ("", ' class="num"')
        shown = (f"<{tag}{right[k in numbers]}>{escape(text)}</{tag}>" for k, text in enumerate(cells))
        return f"<tr>{''.join(shown)}</tr>"

    body = "".join(row("td", cells) for cells in rows)
    return f"<table><thead>{row('th', head)}</thead><tbody>{body}</tbody></table>"


def figure(caption: str, svg: str) -> str:
    """Return a chart under its name."""
    return f"<figure><figcaption>{escape(caption)}</figcaption>{svg}</figure>"


def utc(unix_s: float, *, milliseconds: bool = False) -> str:
    """Date and time in UTC."""
    at = datetime.fromtimestamp(unix_s, UTC)
    return at.strftime("%Y-%m-%d %H:%M:%S") + (f".{at.microsecond // 1000:03}" if milliseconds else "") + " UTC"


def quantity(value: float | None, decimals: int, unit: str) -> str:
    """A number with its unit and a true minus sign; a dash for what is missing."""
    if value is None:
        return "\u2013"
    text = f"{value:.{decimals}f} {_UNITS.get(unit, unit)}"
    return text.replace("-", MINUS).strip()


def signed(value: float, decimals: int, unit: str) -> str:
    """A number with its sign, plus too."""
    return ("+" if value >= 0 else "") + quantity(value, decimals, unit)
