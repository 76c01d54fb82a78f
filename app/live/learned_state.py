"""What earlier runs learned about these cells, in one file of the data folder: charge, capacities, joints."""

import logging
import os
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from app.battery.shape import N_CELLS
from app.live.prediction import LearnedCells
from app.telemetry import FloatArray

log = logging.getLogger(__name__)
REST_SIGMA = 0.01  # of a charge that was known when the service ended: what happened since is not
SELF_DISCHARGE_SIGMA_PER_DAY = 0.001
DAY_NS = 86_400_000_000_000
NOTHING = np.empty((2, 0))


@dataclass(frozen=True)
class LearnedState:
    """The state of charge when the service last ran, and what does not change from day to day."""

    saved_wall_ns: int
    soc: FloatArray  # (96,)
    soc_sigma: FloatArray
    cells: LearnedCells

    def start(self, now_wall_ns: int) -> tuple[FloatArray, FloatArray]:
        """Return (soc, sigma) as far as they can be believed now; a clock that ran backwards counts as no time."""
        days = max(0, now_wall_ns - self.saved_wall_ns) / DAY_NS
        grown = REST_SIGMA**2 + (SELF_DISCHARGE_SIGMA_PER_DAY * days) ** 2
        return self.soc, np.sqrt(self.soc_sigma**2 + grown)


def load_learned_state(path: Path) -> LearnedState | None:
    """Return what was saved, None where there is nothing or it cannot be read (which is logged)."""
    if not path.is_file():
        return None
    try:
        with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
            state = LearnedState(
                int(file["saved_wall_ns"]),
                file["soc"],
                file["soc_sigma"],
                LearnedCells(
                    file["capacity_state"],
                    file["joint_baseline_ohm"],
                    file.get("resistance"),  # older versions saved none
                ),
            )
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
        log.warning("%s cannot be read and is ignored: %s", path, error)
        return None
    shapes = {state.soc.shape, state.soc_sigma.shape, state.cells.joint_baseline_ohm.shape}
    if shapes != {(N_CELLS,)} or state.cells.capacity_state.shape != (6, N_CELLS):
        log.warning("%s is of another accumulator and is ignored", path)
        return None
    return state


def save_learned_state(path: Path, state: LearnedState) -> None:
    """Replace the file as a whole; a full disk is logged and costs only this."""
    draft = path.with_suffix(".new")
    try:
        with draft.open("wb") as file:
            np.savez(
                file,
                saved_wall_ns=state.saved_wall_ns,
                soc=state.soc,
                soc_sigma=state.soc_sigma,
                capacity_state=state.cells.capacity_state,
                joint_baseline_ohm=state.cells.joint_baseline_ohm,
                resistance=NOTHING if state.cells.resistance is None else state.cells.resistance,
            )
            file.flush()
            os.fsync(file.fileno())
        draft.replace(path)
    except OSError as error:
        log.warning("%s was not saved: %s", path, error.strerror or error)
