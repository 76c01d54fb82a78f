"""Which cell failed, and why: what a person concludes from charge used, resistance, heat and what was reported.

A cell that has lost capacity uses more of its charge than the others at the same current. A loose joint adds
resistance and leaves the charge alone. A cell that was merely lower uses what the others use. Numbers in, findings
out.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Final

import numpy as np

from app.analysis.report.findings import LEAST_GROWTH, MISSING_SHARE, SPREAD_SOC, Odd, percent
from app.analysis.survey import Survey
from app.estimation.arrays import median
from app.telemetry.cell_findings import Finding
from app.words import Cell, Message, Quantity

USED_MIN: Final = 0.05  # of the charge, by the median cell: less tells nothing of capacity
USED_MORE: Final = 1.15  # times the median: capacity is lost


def verdicts(
    survey: Survey,
    odd: Sequence[Odd],
    tripped: Sequence[int],
    loose: Sequence[int],
    found: Sequence[Finding] = (),
    blamed: Collection[int] = (),
) -> list[Message]:
    """Return why, of each cell that tripped, was reported, or has more resistance than the others.

    Args:
        survey: of the whole recording.
        odd: the cells that stand out.
        tripped: cells named by trips, in order.
        loose: cells whose joint was reported to have grown.
        found: what the session shows against single cells; who has a finding is explained by it.
        blamed: cells that a cause names: that one of them is like the others is not said.
    """
    resisting = [each.cell for each in odd if each.what == "resistance"]
    by_cell = {each.cell: [other for other in found if other.cell == each.cell] for each in found}
    findings: list[Message] = []
    for cell in dict.fromkeys([*tripped, *by_cell, *loose, *resisting]):
        if cell in by_cell:
            findings += [Message("why-finding", finding=each.message, evidence=each.evidence) for each in by_cell[cell]]
        else:
            verdict = _verdict(survey, cell, is_loose=cell in loose, resists=cell in resisting)
            if verdict.code != "why-like-others" or cell not in blamed:
                findings.append(verdict)
    return findings


def _verdict(survey: Survey, index: int, *, is_loose: bool, resists: bool) -> Message:
    cell = Cell(index)
    used_by_cell = survey.soc_first - survey.soc_last
    usual_used, usual_ohm = median(used_by_cell), median(survey.resistance_ohm)
    tells_charge = usual_used >= USED_MIN and bool(np.isfinite(used_by_cell[index]))
    growth = float(survey.resistance_ohm[index] / usual_ohm - 1.0) if usual_ohm > 0.0 else np.nan
    used, usual = percent(float(used_by_cell[index])), percent(usual_used)
    if tells_charge and used_by_cell[index] > USED_MORE * usual_used:
        holds = percent(usual_used / float(used_by_cell[index]))
        if growth > LEAST_GROWTH:
            more = percent(growth)
            return Message("why-capacity-and-resistance", cell=cell, used=used, usual=usual, holds=holds, more=more)
        return Message("why-capacity", cell=cell, used=used, usual=usual, holds=holds)
    if resists or (is_loose and growth > LEAST_GROWTH):
        more = Quantity(1000 * float(survey.resistance_ohm[index] - usual_ohm), "mohm", 2)
        if tells_charge:
            return Message("why-joint", cell=cell, more=more, used=used, usual=usual)
        return Message("why-resistance", cell=cell, more=more)
    behind = median(survey.soc_first) - survey.soc_first[index]
    if behind > SPREAD_SOC:
        return Message("why-began-lower", cell=cell, below=percent(float(behind)))
    if survey.missing[index] > MISSING_SHARE * max(survey.samples, 1):
        return Message("why-not-measured", cell=cell)
    return Message("why-like-others", cell=cell)
