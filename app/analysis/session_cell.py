"""The cell file of then: what a session was estimated with."""

from __future__ import annotations

from app.estimation.cell_model.cell_file import load_cell, parse_cell
from app.estimation.cell_model.circuit import CellModel
from app.estimation.errors import EstimatorError
from app.sessions.reading.reader import SessionFile


def cell_of(session: SessionFile) -> tuple[CellModel, bool]:
    """Return the cell model that a session was recorded with, True; today's default, False, where it keeps none."""
    text = session.cell_file
    if text is not None:
        try:
            return parse_cell(text, session.path.name), True
        except EstimatorError:
            pass  # of a format that this version does not read
    return load_cell(), False
