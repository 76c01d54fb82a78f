"""The cell file and configurations that a session is judged with: those it was recorded with, or today's."""

from __future__ import annotations

from app import __version__
from app.analysis.limits import limits_of_profile, limits_over_time, names_of_signals
from app.errors import AppError, NotNow
from app.estimation.cell_model.cell_file import load_cell, parse_cell
from app.estimation.cell_model.circuit import CellModel
from app.estimation.errors import EstimatorError
from app.sessions.reading.reader import SessionFile
from app.words import Message, RenderedMessage, sentence


def cell_of(session: SessionFile) -> tuple[CellModel, bool]:
    """Return the cell model that a session was recorded with, True; today's default, False, where it keeps none."""
    text = session.cell_file
    if text is not None:
        try:
            return session.parse(parse_cell, text), True
        except NotNow:
            raise
        except (EstimatorError, AppError, RecursionError):
            pass  # a format that this version does not read
    return load_cell(), False


def judged_by(session: SessionFile, chosen_cell: str | None = None) -> list[RenderedMessage]:
    """Return what of then judges a session, and what of today; `chosen_cell` takes the place of the one of then."""
    n_configs = len(session.configs())
    messages = [Message("report-versions", recorded=session.info.voltwall, judged=__version__)]
    if n_configs:
        messages.append(Message("report-limits-of-then", n=n_configs))
    else:
        is_stated = bool(limits_of_profile(session.battery) or names_of_signals(session.battery))
        messages.append(Message("report-limits-of-profile") if is_stated else Message("report-limits-unknown"))
    if chosen_cell is not None:
        messages.append(Message("judged-cell-chosen", cell=chosen_cell))
    else:
        messages.append(Message("report-cell-of-then") if cell_of(session)[1] else Message("report-cell-of-today"))
    return [sentence(message) for message in messages]


def unlike(first: SessionFile, second: SessionFile) -> list[RenderedMessage]:
    """Return in what two sessions were not judged alike when they were recorded."""
    messages = []
    if (first.battery.name, first.battery.segments) != (second.battery.name, second.battery.segments):
        messages.append(Message("unlike-batteries", a=first.battery.name, b=second.battery.name))
    versions = first.info.voltwall, second.info.voltwall
    if versions[0] != versions[1]:
        messages.append(Message("unlike-versions", a=versions[0], b=versions[1]))
    if first.cell_file is None or second.cell_file is None:
        messages.append(Message("unlike-cells-unknown"))
    elif first.cell_file != second.cell_file:
        messages.append(Message("unlike-cells", a=cell_of(first)[0].name, b=cell_of(second)[0].name))
    limits = _last_limits(first), _last_limits(second)
    if not all(limits):
        messages.append(Message("unlike-limits-unknown"))
    messages += [
        Message("unlike-limit", name=name, a=limits[0][name], b=limits[1][name])
        for name in limits[0]
        if name in limits[1] and limits[0][name] != limits[1][name]
    ]
    return [sentence(message) for message in messages]


def _last_limits(session: SessionFile) -> dict[str, float]:
    return limits_over_time(session).at()
