"""Which cell failed, and why: what a person concludes from charge used, resistance, heat and what was reported.

A cell that has lost capacity uses more of its charge than the others at the same current. A loose joint adds
resistance and leaves the charge alone. A cell that was merely lower uses what the others use. Numbers in, sentences
out.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from app.analysis.black_box.excerpt import place
from app.analysis.report.findings import LEAST_GROWTH, MISSING_SHARE, SPREAD_SOC, Odd
from app.analysis.survey import Survey
from app.estimation.arrays import FloatArray

USED_MIN: Final = 0.05  # of the charge, by the median cell: less tells nothing of capacity
USED_MORE: Final = 1.15  # times the median: capacity is lost
MOST: Final = 3  # cells that are explained


def verdicts(survey: Survey, odd: Sequence[Odd], tripped: Sequence[int], loose: Sequence[int]) -> list[str]:
    """Return a sentence or two on each cell that tripped, was reported, or resists more than the others.

    Args:
        survey: of the whole recording.
        odd: the cells that stand out.
        tripped: cells named by trips, in order.
        loose: cells whose joint was reported to have grown.
    """
    resisting = [each.cell for each in odd if each.what == "resistance"]
    suspects = list(dict.fromkeys([*tripped, *loose, *resisting]))[:MOST]
    return [_verdict(survey, cell, is_loose=cell in loose, resists=cell in resisting) for cell in suspects]


def _verdict(survey: Survey, cell: int, *, is_loose: bool, resists: bool) -> str:
    where = place(cell)
    used = survey.soc_first - survey.soc_last
    usual_used, usual_ohm = _median(used), _median(survey.resistance_ohm)
    tells_charge = usual_used >= USED_MIN and bool(np.isfinite(used[cell]))
    growth = float(survey.resistance_ohm[cell] / usual_ohm - 1.0) if usual_ohm > 0.0 else np.nan
    charge = f"it used {100 * used[cell]:.0f} % of its charge, the others {100 * usual_used:.0f} %"
    if tells_charge and used[cell] > USED_MORE * usual_used:
        resistance = f", and it resists {100 * growth:.0f} % more" if growth > LEAST_GROWTH else ""
        holds = 100 * usual_used / used[cell]
        return (
            f"{_capital(where)} has lost capacity: {charge}, so it holds about {holds:.0f} % of what they hold"
            f"{resistance}. Replace the module; balancing does not help."
        )
    if resists or (is_loose and growth > LEAST_GROWTH):
        more = 1000 * (survey.resistance_ohm[cell] - usual_ohm)
        like = f", while its charge fell as theirs did ({charge})" if tells_charge else ""
        what = "a joint or a sense wire, not the cell" if tells_charge else "a joint, a sense wire or the cell"
        return (
            f"{_capital(where)} resists {more:.2f} m\u03a9 more than the others{like}: {what}. "
            "Look at its bolts and welds before the next run."
        )
    behind = _median(survey.soc_first) - survey.soc_first[cell]
    if behind > SPREAD_SOC:
        return f"{_capital(where)} began {100 * behind:.0f} % below the others and used what they used: balance it."
    if survey.missing[cell] > MISSING_SHARE * max(survey.samples, 1):
        return f"{_capital(where)} was not always measured, and is sound where it was: look at its sense wire."
    return f"{_capital(where)} used its charge and resisted like the others: nothing says that the cell is at fault."


def _median(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
