"""Black boxes of a recorded session: out of its frames and events, by the same code that makes them live."""

from __future__ import annotations

import logging
import threading
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, replace

import numpy as np

from app.analysis.black_box.box import BlackBox, box_from_json, cause_findings, findings_of
from app.analysis.black_box.excerpt import BoxWindow, build
from app.analysis.incidents import AFTER_S, BEFORE_S, Trigger
from app.analysis.limits import limits_over_time
from app.analysis.root_cause.from_session import incidents_of, verdict_of
from app.analysis.root_cause.judge import UNEXPLAINED, Cause, trip_cause
from app.analysis.session_cell import cell_of
from app.analysis.session_judge import CellJudge
from app.analysis.session_survey import read_pieces
from app.errors import AppError
from app.estimation.arrays import FloatArray, latest_at
from app.sessions.black_box_store import BlackBoxStore, StoredBox
from app.sessions.catalogue import Catalogue
from app.sessions.errors import RecordingFailed, SchemaTooNew
from app.sessions.reading.reader import SessionFile
from app.telemetry.cell_findings import Finding, agreeing, findings_in_words, sensors_of
from app.words import RenderedMessage
from firmware_protocol.config_image import image_hash
from firmware_protocol.memory_map import STATUS_FLAGS

log = logging.getLogger(__name__)
_END_S = 10.0
STORE = "blackboxes.sqlite"  # in a data folder
SAME_S = 0.01  # between a stored time and the one it was read from
_FIELDS = ("i_fs", "v", "t", "estimate.soc", "status.flags")


def black_boxes(session: SessionFile) -> list[BlackBox]:
    """Return a black box for every incident of a session, in order."""
    groups = incidents_of(session)
    if not groups:
        return []
    configs, limits_then = session.configs(), limits_over_time(session)
    session_id = session.info.id
    judge = CellJudge(cell_of(session)[0], session.battery.segments)
    for piece in read_pieces(session):
        judge.add(piece)
    judge.result()
    boxes = []
    for group in groups:
        images = [config.image for config in configs if config.t_mono_ns <= group[0].mono_s * 1e9]
        image = images[-1] if images else None
        window = read_window(session, group)
        config_hash = None if image is None else image_hash(image)
        known_s = session.unix_s(round(group[-1].mono_s * 1e9)) + AFTER_S
        cause = verdict_of(session, group)
        findings = findings_in_words(judge.as_of(known_s), sensors_of(session.battery.sensors, session.battery.n_cells))
        limits = limits_then.at(session.unix_s(round(group[0].mono_s * 1e9)))
        box = build(
            group,
            window,
            session_id=session_id,
            config_hash=config_hash,
            limits=limits,
            is_simulated=session.info.metadata.get("source") == "simulator",
            segments=session.battery.segments,
        )
        boxes.append(with_cause(box, cause, findings))
    return boxes


def with_cause(box: BlackBox, cause: Cause | None, findings: Sequence[Finding]) -> BlackBox:
    """Return a box with the verdict on it and what was known against cells, without the verdicts on other trips."""
    others = [
        finding for finding in findings if finding.evidence.code != "evidence-verdict" or finding.cell == box.cell
    ]
    agreed = agreeing(others, [] if cause is None else [trip_cause(cause)])
    return replace(box, cause=cause, findings=[*findings_of(box, agreed), *cause_findings(cause, box.segments)])


def is_explained(box: BlackBox) -> bool:
    """It has a cause: an earlier version looked for none, and what is unknown may be known to its session since."""
    return box.cause is not None and box.cause.code != UNEXPLAINED


def explained(session: SessionFile, box: BlackBox) -> BlackBox:
    """Return a box with the verdict by its session; as it is where the session does not hold its event."""
    for group in incidents_of(session):
        if any(trigger.code == box.code and abs(trigger.at_s - box.at) < SAME_S for trigger in group):
            cause = verdict_of(session, group)
            of_cause = cause_findings(box.cause, box.segments)  # they go with it
            kept = [finding for finding in box.findings if finding not in of_cause]
            kept = [finding for finding in kept if cause is None or not _is_of_cell(finding, cause.cell)]
            return replace(box, cause=cause, findings=[*kept, *cause_findings(cause, box.segments)])
    return box


def _is_of_cell(message: RenderedMessage, cell: int | None) -> bool:
    """It is what a judge had found of a cell."""
    inner = message.args.get("finding")
    return cell is not None and isinstance(inner, Mapping) and inner["args"]["cell"].get("index") == cell


def keep_black_boxes(session: SessionFile, store: BlackBoxStore) -> list[StoredBox]:
    """Make the black boxes of a session unless all are kept and complete, and return all of it, newest first."""
    stored = store.stored(session.info.id)
    if len(stored) >= len(incidents_of(session)) and all(box.is_complete for box in stored):
        return stored
    for box in black_boxes(session):
        store_box(store, box)
    return store.stored(session.info.id)


def boxes_of(session: SessionFile) -> list[BlackBox]:
    """Return the black boxes of a session in order, as the data folder that it is in keeps them; else out of its file.

    Raises:
        NotASession: one of them cannot be read.
    """
    kept_in = session.path.resolve().parent.parent / STORE
    if session.path.resolve().parent.name != "sessions" or not kept_in.is_file():
        return black_boxes(session)
    try:
        with closing(BlackBoxStore(kept_in)) as store:
            boxes = [stored_box(store, box.id) for box in reversed(keep_black_boxes(session, store))]
    except (RecordingFailed, SchemaTooNew):  # a medium that is read only, or a newer program's
        return black_boxes(session)
    return [box if is_explained(box) else explained(session, box) for box in boxes if box is not None]


def store_box(store: BlackBoxStore, box: BlackBox, *, revises: bool = False) -> bool:
    """Keep a box; False where one that is at least as complete is there, or with `revises` more complete.

    Raises:
        RecordingFailed: the disk does not take it.
    """
    listed = StoredBox(box.id, box.at, box.session_id, box.code, box.severity, box.cell, box.message, box.is_complete)
    return store.add(listed, asdict(box), revises=revises)


def stored_box(store: BlackBoxStore, box_id: str) -> BlackBox | None:
    """Return a box, None where there is none of this id; one of an earlier version gets its findings.

    Raises:
        NotASession: it cannot be read.
    """
    body = store.get(box_id)
    if body is None:
        return None
    box = box_from_json(body)
    return box if box.findings else replace(box, findings=[*findings_of(box), *cause_findings(box.cause, box.segments)])


def read_window(session: SessionFile, group: Sequence[Trigger]) -> BoxWindow:
    """Return the samples around an incident at full rate."""
    offset_s = session.unix_s(0)
    first_s, last_s = group[0].mono_s - BEFORE_S + offset_s, group[-1].mono_s + AFTER_S + offset_s
    samples_of: dict[str, list[tuple[FloatArray, FloatArray]]] = {name: [] for name in _FIELDS}
    for piece in session.fields(_FIELDS, first_s, last_s):
        for name, samples in piece.items():
            samples_of[name].append((samples.time_s, samples.values))
    time_s = np.concatenate([times for times, _ in samples_of["v"] or samples_of["i_fs"]] or [np.empty(0)])
    width = {"i_fs": 1, "status.flags": 1}
    table = {name: _onto(time_s, samples_of[name], width.get(name, session.battery.n_cells)) for name in _FIELDS}
    flags = table["status.flags"][:, 0]
    return BoxWindow(
        mono_s=time_s - offset_s,
        current_a=table["i_fs"][:, 0],
        voltage_v=table["v"],
        temperature_degc=table["t"],
        soc=table["estimate.soc"],
        fit=_bit(flags, "fit"),
        load=_bit(flags, "load"),
    )


def _bit(flags: FloatArray, name: str) -> FloatArray:
    is_finite = np.isfinite(flags)
    bits = np.where(is_finite, flags, 0.0).astype(np.int64) >> STATUS_FLAGS.index(name) & 1
    return np.where(is_finite, bits, np.nan)


def _onto(time_s: FloatArray, parts: Sequence[tuple[FloatArray, FloatArray]], width: int) -> FloatArray:
    """The latest row at each time, NaN before the first."""
    if not parts:
        return np.full((len(time_s), width), np.nan)
    own_s, values = np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
    return latest_at(time_s, own_s, values)


class BlackBoxesOfSessions:
    """Looks once at each finished session of a catalogue."""

    def __init__(
        self, catalogue: Catalogue, store: BlackBoxStore, is_simulated: bool, lost: threading.Event | None = None
    ) -> None:
        """Keep boxes in `store`: of the car's sessions, or of those of the simulated one; all again once `lost`."""
        self._catalogue = catalogue
        self._store = store
        self._is_simulated = is_simulated
        self._lost = lost or threading.Event()
        self._seen: set[str] = set()
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._is_closing = False

    def update(self) -> None:
        """Begin to look at what is new, in the background; nothing where that is under way."""
        with self._lock:
            if not self._is_closing and (self._thread is None or not self._thread.is_alive()):
                self._thread = threading.Thread(target=self.read_new, name="black boxes", daemon=True)
                self._thread.start()

    def read_new(self) -> None:
        """Look at what is new; one thread at a time."""
        if self._lost.is_set():
            self._lost.clear()
            self._seen.clear()
        for info in self._catalogue.list():
            if self._is_closing:
                return
            is_ours = (info.metadata.get("source") == "simulator") == self._is_simulated
            if not (info.is_closed and info.events and is_ours) or info.id in self._seen:
                continue
            self._seen.add(info.id)
            try:
                with self._catalogue.open(info.id) as session:
                    keep_black_boxes(session, self._store)
            except AppError as error:
                log.warning("no black boxes of session %s: %s", info.id, error)
            except Exception:  # the sessions after it are looked at all the same
                log.exception("no black boxes of session %s", info.id)

    def close(self) -> None:
        """Stop after the session under way."""
        with self._lock:
            self._is_closing = True
        if self._thread is not None:
            self._thread.join(_END_S)
