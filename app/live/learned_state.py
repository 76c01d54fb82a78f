"""Results of earlier runs about these cells, in one file of the data folder: charge, capacities, joints."""

import json
import logging
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from hashlib import sha256
from io import BytesIO
from math import isnan
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import ArrayLike

from app.battery.library import file_name_of
from app.estimation.cell_model.cell_file import format_cell
from app.estimation.cell_model.circuit import CellModel
from app.estimation.health.cell_finding import CellFinding
from app.estimation.health.cell_watch import CellWatchMemory
from app.estimation.health.charge_watch import STATES, ChargeMemory
from app.estimation.health.joint_watch import LooseJoints
from app.live.prediction import LearnedCells
from app.live.remembered_charge import MasterCount, RememberedCharge
from app.sources.data_file import replace_file
from app.telemetry import FloatArray
from app.words import condition_of

log = logging.getLogger(__name__)
NOTHING = np.empty((2, 0))


@dataclass(frozen=True)
class LearnedState:
    """The state of charge when the service last ran, and what does not change from day to day."""

    charge: RememberedCharge
    cells: LearnedCells
    cell_file: str = ""  # digest of the one that resistances were learned against


def learned_file(battery: str, *, is_team: bool) -> str:
    """Return the name of the file of a battery: each keeps its own."""
    return "cells.npz" if is_team else f"cells-{file_name_of(battery)}.npz"


def digest_of(cell: CellModel) -> str:
    """Return a digest of all that a cell file says."""
    return sha256(format_cell(cell).encode()).hexdigest()[:16]


def load_learned_state(path: Path, n_cells: int, cell: CellModel | None = None) -> LearnedState | None:
    """Return what was saved, None where there is nothing or it cannot be read (which is logged).

    Resistances are shares of those of a cell file: where `cell` is another one, they are dropped, which is logged too.
    Capacities are in ampere-hours and stay.
    """
    if not path.is_file():
        return None
    try:
        with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
            state = LearnedState(
                RememberedCharge(int(file["saved_wall_ns"]), file["soc"], file["soc_sigma"], _counted(file)),
                LearnedCells(
                    file["capacity_state"],
                    file["joint_baseline_ohm"],
                    file.get("resistance"),  # older versions saved none
                    _watched(file, n_cells),
                ),
                str(file["cell_file"]) if "cell_file" in file else "",
            )
    except (OSError, ValueError, KeyError, TypeError, EOFError, RecursionError, BadZipFile) as error:
        log.warning("%s cannot be read and is ignored: %s", path, error)
        return None
    shapes = {state.charge.soc.shape, state.charge.soc_sigma.shape, state.cells.joint_baseline_ohm.shape}
    if shapes != {(n_cells,)} or state.cells.capacity_state.shape != (6, n_cells):
        log.warning("%s is of another accumulator and is ignored", path)
        return None
    # versions before kept no digest, and had no model of the surface
    is_same = cell is None or (state.cell_file == digest_of(cell) if state.cell_file else not cell.has_surface)
    if not is_same and state.cells.resistance is not None:
        log.warning("%s: resistances were learned against another cell file and are learned again", path)
        state = replace(state, cells=replace(state.cells, resistance=None))
    return state


def save_learned_state(path: Path, state: LearnedState) -> None:
    """Replace the file as a whole; a full disk is logged and costs only this."""
    content = BytesIO()
    np.savez(content, allow_pickle=False, **_arrays(state))
    try:
        replace_file(path, content.getvalue())
    except OSError as error:
        log.warning("%s was not saved: %s", path, error.strerror or error)


def _arrays(state: LearnedState) -> dict[str, ArrayLike]:
    cells, charge = state.cells, state.charge
    return {
        "saved_wall_ns": charge.t_wall_ns,
        "soc": charge.soc,
        "soc_sigma": charge.soc_sigma,
        **{f"count_{name}": value for name, value in asdict(charge.count).items() if value is not None},
        "cell_file": state.cell_file,
        "capacity_state": cells.capacity_state,
        "joint_baseline_ohm": cells.joint_baseline_ohm,
        "resistance": NOTHING if cells.resistance is None else cells.resistance,
        **_watch_arrays(cells.watch),
    }


def _counted(file: Mapping[str, FloatArray]) -> MasterCount:
    """The master's count; older versions saved none."""
    stored = ((field.name, file.get(f"count_{field.name}")) for field in fields(MasterCount))
    values: dict[str, Any] = {name: value.item() for name, value in stored if value is not None}
    return MasterCount(**values)


def _watch_arrays(watch: CellWatchMemory | None) -> dict[str, FloatArray]:
    """What `CellWatch` remembers, as arrays; findings as JSON in one array of a text."""
    if watch is None:
        return {}
    text = json.dumps([asdict(finding) for finding in watch.findings])
    arrays: dict[str, FloatArray] = {"findings": np.array(text)}
    if watch.loose is not None:
        arrays["loose_ohm"] = np.array((watch.loose.excess_ohm, watch.loose.sigma_ohm))
    if watch.charge is not None:
        charge = watch.charge
        arrays |= {
            "charge_at": np.array((charge.time_s, charge.evidence_s, charge.soc)),
            "charge_mean": charge.mean,
            "charge_cov": charge.cov,
        }
    return arrays


def _finding(stored: dict[str, Any]) -> CellFinding:
    """A finding as it was kept; an earlier version had one code for a sensor without a value and with a false one."""
    code = condition_of(stored["code"])
    if isnan(stored["value"]):
        code = {
            "temperature-sensor-fault": "temperature-sensor-open",
            "cell-voltage-stuck": "cell-voltage-missing",
        }.get(code, code)
    return CellFinding(**stored | {"code": code, "neighbours": tuple(stored["neighbours"])})


def _watched(file: Mapping[str, FloatArray], n_cells: int) -> CellWatchMemory | None:
    """The reverse; None of a file of an older version, which knows the joints' baseline only.

    Raises:
        ValueError, TypeError: the file is damaged.
    """
    if "findings" not in file:
        return None
    findings = [_finding(finding) for finding in json.loads(str(file["findings"]))]
    loose = LooseJoints(*file["loose_ohm"]) if "loose_ohm" in file else None
    charge = None
    if "charge_at" in file and file["charge_mean"].shape == (STATES, n_cells):
        time_s, evidence_s, soc = file["charge_at"].tolist()
        charge = ChargeMemory(time_s, evidence_s, soc, file["charge_mean"], file["charge_cov"])
    return CellWatchMemory(file["joint_baseline_ohm"], loose, charge, tuple(findings))
