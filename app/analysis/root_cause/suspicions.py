"""All hypotheses, asked about one recording."""

from __future__ import annotations

from app.analysis.root_cause.air import pack_suspicions
from app.analysis.root_cause.boards import board_suspicions
from app.analysis.root_cause.cells import cell_suspicions
from app.analysis.root_cause.charging import charger_suspicions
from app.analysis.root_cause.current import current_suspicions
from app.analysis.root_cause.links import link_suspicions
from app.analysis.root_cause.recording import Recording, Suspicion
from app.analysis.root_cause.relays import relay_suspicions
from app.estimation.cell_model.circuit import CellModel


def suspicions(recording: Recording, model: CellModel, at_s: float) -> list[Suspicion]:
    """Return everything that may be wrong; `at_s` is the instant that is asked about, unix time."""
    return [
        *link_suspicions(recording),
        *board_suspicions(recording),
        *charger_suspicions(recording),
        *relay_suspicions(recording),
        *current_suspicions(recording, model),
        *pack_suspicions(recording, model),
        *cell_suspicions(recording, model, at_s),
    ]
