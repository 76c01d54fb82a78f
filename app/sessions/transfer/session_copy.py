"""A copy of another service's session, piece by piece: what is here, what is missing, and the session made of it.

Pieces are files in `.copies/ID` next to the sessions until the copy is whole, each named by its number and the ids of
its frames; so a copy goes on after any interruption, and neighbours tell whether a frame is missing between them.
"""

import base64
import contextlib
import hashlib
import json
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from app.sessions.info import SessionInfo
from app.sessions.reading.parse import Parse, in_process
from app.sessions.recording.session_writer import SessionWriter, TableRow
from app.sessions.storage.chunks import ESTIMATE_MISSING, ESTIMATE_SCALE
from app.sessions.storage.files import FETCHED, SUFFIX, merge_log
from app.sessions.transfer.pieces import PIECE_NS, SessionPiece, parse_piece
from app.sources.data_file import parse_object
from app.sources.loaded_battery import battery_from_files

COPIES = ".copies"
_HALF = ".copying-"  # folder in which a session is being written
_LEFT_S = 600.0  # nothing of it has changed for so long: whoever wrote it is gone
_NAME = re.compile(r"(\d{6,9})\.(\d+)-(\d+)\.(\d+)-(\d+)\.piece")
_PARTIAL = "partial"  # mark in the note of a session that lacks pieces
Ids = tuple[int, int, int, int]
Span = tuple[int, int]  # first and last number of pieces


class SessionCopy:
    """The copy `local_id` in a folder of sessions."""

    def __init__(self, folder: Path, local_id: str) -> None:
        self.id = local_id
        self._path = folder / f"{local_id}{SUFFIX}"
        self._pieces = folder / COPIES / local_id

    @classmethod
    def all_in(cls, folder: Path) -> "list[SessionCopy]":
        """Every copy that is not whole yet, newest first."""
        copies = [cls(folder, path.parent.name) for path in (folder / COPIES).glob("*/head.json")]
        dated = [(head["start_wall_ns"], copy) for copy in copies if (head := copy.head)]  # one may be whole by now
        return [copy for _, copy in sorted(dated, key=lambda pair: int(pair[0]), reverse=True)]

    @property
    def head(self) -> dict[str, Any]:
        """The other service's metadata of the session; empty before that."""
        try:
            return parse_object((self._pieces / "head.json").read_bytes())
        except (OSError, ValueError):
            return {}

    def note_head(self, head: dict[str, Any]) -> None:
        """Keep what the other service says; a session that began at another moment is another one."""
        before = self.head
        if before and before["start_mono_ns"] != head["start_mono_ns"]:
            shutil.rmtree(self._pieces)
        self._write("head.json", json.dumps(head).encode())

    def have(self) -> dict[int, Ids]:
        """Number of each piece that is here, with the ids of its frames and CAN frames."""
        names = [match for path in self._pieces.glob("*.piece") if (match := _NAME.fullmatch(path.name))]
        return {int(m[1]): (int(m[2]), int(m[3]), int(m[4]), int(m[5])) for m in names}

    def missing(self) -> list[Span]:
        """Stretches of pieces that are there and not here, in order."""
        here = self.have()
        spans: list[Span] = []
        for number in range(int(self.head.get("pieces", 0))):
            if number in here:
                continue
            if spans and spans[-1][1] == number - 1:
                spans[-1] = (spans[-1][0], number)
            else:
                spans.append((number, number))
        return spans

    def put(self, number: int, body: bytes, digest: str) -> None:
        """Keep a piece.

        Raises:
            ValueError: it is not what was sent, or its frames do not go on where its neighbours' end. Those are dropped
                with it, and fetched again.
        """
        if hashlib.sha256(body).hexdigest() != digest:
            raise ValueError("it is not what was sent")
        ids = parse_piece(body).ids
        here = self.have()
        wrong = [
            other
            for other, fits in ((number - 1, _follows), (number + 1, lambda a, b: _follows(b, a)))
            if other in here and not fits(here[other], ids)
        ]
        if wrong or (number == 0 and (ids[0], ids[2]) != (1, 1)):
            for other in wrong:
                (self._pieces / _name(other, here[other])).unlink(missing_ok=True)
            raise ValueError("its frames do not go on where its neighbours' end")
        self._write(_name(number, ids), body)

    def is_whole(self) -> bool:
        """Return whether the session has ended there and every frame of it is here, by their ids."""
        head, here = self.head, self.have()
        if not head or head["recording"] or set(here) != set(range(int(head["pieces"]))):
            return False
        in_order = [here[number] for number in sorted(here)]
        last = in_order[-1]
        return all(_follows(a, b) for a, b in pairwise(in_order)) and (last[1] - 1, last[3] - 1) == (
            head["frames"],
            head["can_frames"],
        )

    def build(self, parse: Parse = in_process) -> Path:
        """Write the session of all pieces that are here, its battery read by `parse`; a whole copy needs no pieces.

        Raises:
            OSError, sqlite3.Error: the disk does not take it; the pieces stay.
        """
        head, is_whole = self.head, self.is_whole()
        missing = [[first * PIECE_NS / 1e9, (last + 1) * PIECE_NS / 1e9] for first, last in self.missing()]
        metadata = dict(head["metadata"]) | ({} if is_whole else {"missing": missing})
        info = SessionInfo(
            self.id, self._path, head["name"], head["start_wall_ns"], head["start_mono_ns"],
            voltwall=head["voltwall"], map_hash=head["map_hash"], metadata=metadata,
        )  # fmt: skip
        with tempfile.TemporaryDirectory(dir=self._path.parent, prefix=_HALF) as folder:
            made = Path(folder) / self._path.name
            made.touch()
            self._write_session(replace(info, path=made), head, parse)
            for suffix in ("-wal", "-shm"):
                self._path.with_name(self._path.name + suffix).unlink(missing_ok=True)
            made.replace(self._path)
        note = self._path.with_name(self._path.name + FETCHED)
        note.write_text(str(head["bytes"]) if is_whole else _PARTIAL)
        if is_whole:
            shutil.rmtree(self._pieces)
        return self._path

    def _write_session(self, info: SessionInfo, head: dict[str, Any], parse: Parse) -> None:
        files = {name: base64.b64decode(data) for name, data in head["battery_files"]}
        writer = SessionWriter(info, head["cell_file"], parse(battery_from_files, files) if files else None)
        try:
            for piece in self._in_order():
                rows = list(_table_rows(piece))
                writer.write(rows)
                newest = max((row[0] for table, row in rows if table != "meta"), default=None)
                if newest is not None:
                    writer.close_chunk_if_due(newest)
            if head["closed"]:
                writer.close(head["end_mono_ns"], head["end_wall_ns"])
        finally:
            writer.abandon()
        merge_log(info.path)

    def _in_order(self) -> Iterator[SessionPiece]:
        here = self.have()
        for number in sorted(here):
            yield parse_piece((self._pieces / _name(number, here[number])).read_bytes())

    def state(self) -> dict[str, Any]:
        """Return the state to show: unix times of what is missing, of `pieces` of `piece_s` each."""
        head, missing = self.head, self.missing()
        start_s = head.get("start_wall_ns", 0) / 1e9
        piece_s = PIECE_NS / 1e9
        lacking = sum(last - first + 1 for first, last in missing)
        return {
            "id": self.id,
            "name": head.get("name", self.id),
            "started": start_s,
            "recording": bool(head.get("recording")),
            "piece_s": piece_s,
            "pieces": int(head.get("pieces", 0)),
            "missing": [(start_s + first * piece_s, start_s + (last + 1) * piece_s) for first, last in missing],
            "missing_s": lacking * piece_s,
        }

    def _write(self, name: str, content: bytes) -> None:
        """Put a file where a power cut leaves it whole or not there."""
        self._pieces.mkdir(parents=True, exist_ok=True)
        part = self._pieces / f".{name}.part"
        with part.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        part.replace(self._pieces / name)


def remove_left_halves(folder: Path, now_s: float) -> None:
    """Remove what interrupted copies left half written next to the sessions; `now_s` is unix time."""
    for half in folder.glob(f"{_HALF}*"):
        with contextlib.suppress(OSError):  # whoever writes it may end meanwhile
            if max(path.stat().st_mtime for path in (half, *half.iterdir())) < now_s - _LEFT_S:
                shutil.rmtree(half)


def _name(number: int, ids: Ids) -> str:
    return "{:06}.{}-{}.{}-{}.piece".format(number, *ids)


def _follows(before: Ids, after: Ids) -> bool:
    """Whether the frames of one piece go on in the next."""
    return (before[1], before[3]) == (after[0], after[2])


def _table_rows(piece: SessionPiece) -> Iterator[TableRow]:
    for table, rows in piece.rows.items():
        if table == "estimates":
            yield from ((table, (t, up, _estimate(soc), _estimate(sigma))) for t, up, soc, sigma in rows)
        else:
            yield from ((table, row) for row in rows)


def _estimate(counts: bytes) -> Any:
    numbers = np.frombuffer(counts, "<u2")
    return np.where(numbers == ESTIMATE_MISSING, np.nan, numbers * ESTIMATE_SCALE)
