"""Uploaded recordings of other systems on their way to becoming sessions: one import at a time."""

import itertools
import re
import shutil
import tempfile
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from app.battery.library import bundled_profiles
from app.errors import AppError, ImportFailed, NotNow, message_of, unknown_name
from app.sessions.transfer.import_session import ImportedSession, NewPipeline, import_file
from app.sessions.worker import DEFINITIONS, INSPECTION, Workers, import_limits
from app.sources.dbc.dbc_file import DEFINITION_ENDINGS
from app.sources.loaded_battery import LoadedBattery, load_battery
from app.sources.recordings.guess import guess
from app.sources.recordings.import_mapping import ImportMapping, ImportMappingStore
from app.sources.recordings.kind import is_can_log
from app.sources.recordings.preview import Preview, preview
from app.sources.recordings.table import read_table
from app.telemetry import Severity
from app.words import Message, Text

MAX_UPLOADS = 8  # the oldest one gives way
_UNSAFE = re.compile(r"[^A-Za-z0-9._ -]+")


@dataclass(frozen=True, slots=True)
class Upload:
    """A file that came in; `columns` and `guessed` of a table only."""

    id: int
    filename: str
    path: Path
    is_can: bool
    columns: tuple[str, ...] = ()
    guessed: ImportMapping | None = None


@dataclass(frozen=True, slots=True)
class ImportState:
    """Progress of an import: `done` of `total`; its rows once it is a session."""

    filename: str
    is_running: bool = True
    done: int = 0
    total: int = 0
    session_id: str | None = None
    notes: tuple[Message, ...] = ()
    error: Text | None = None


def columns_of(path: Path) -> tuple[tuple[str, ...], ImportMapping] | None:
    """Return the columns of a table's file and what they seem to be; None of a CAN log.

    Raises:
        ImportFailed: there is no table in it.
    """
    if is_can_log(path):
        return None
    table = read_table(path)
    return tuple(table.columns), guess(table)


class ImportJobs:
    """Keeps uploads until they are imported or the service ends."""

    def __init__(
        self,
        data: Path,
        new_pipeline: NewPipeline,
        note: Callable[[Severity, str, Message], None],
        workers: Workers,
        battery: LoadedBattery | None = None,
    ) -> None:
        """Prepare for uploads; those of an earlier run are deleted.

        Args:
            data: folder of the service.
            new_pipeline: see `import_file`; goes to another process.
            note: into the event log.
            workers: read the files.
            battery: default for a CAN log; None: the team's own.
        """
        self._workers = workers
        self._folder = data / "imports"
        self._sessions = data / "sessions"
        self._new_pipeline = new_pipeline
        self._note = note
        self._battery = battery
        self._lock = threading.Lock()
        self._ids = itertools.count(1)
        self._uploads: dict[int, Upload] = {}
        self.mappings = ImportMappingStore(data / "profiles")
        self.state: ImportState | None = None
        shutil.rmtree(self._folder, ignore_errors=True)

    def new_path(self, filename: str) -> tuple[int, Path]:
        """Return the number and the place of an upload that is about to come."""
        number = next(self._ids)
        folder = self._folder / str(number)
        folder.mkdir(parents=True)
        return number, folder / (_UNSAFE.sub("_", Path(filename).name).lstrip(".")[-100:] or "upload")

    def discard(self, path: Path) -> None:
        """Delete an upload that did not come whole."""
        shutil.rmtree(path.parent, ignore_errors=True)

    def inspect(self, number: int, path: Path) -> Upload:
        """Keep an upload and return what it is; profiles and message definitions are just kept.

        Raises:
            ImportFailed: it is no table.
        """
        upload = Upload(number, path.name, path, is_can=False)
        if not path.name.lower().endswith((".toml", *DEFINITION_ENDINGS)):
            try:
                columns = self._workers.run(INSPECTION, columns_of, path)
            except AppError:
                self.discard(path)
                raise
            if columns is None:
                upload = replace(upload, is_can=True)
            else:
                upload = replace(upload, columns=columns[0], guessed=columns[1])
        with self._lock:
            self._uploads[number] = upload
            while len(self._uploads) > MAX_UPLOADS:
                self.discard(self._uploads.pop(next(iter(self._uploads))).path)
        return upload

    def path_of(self, number: int) -> Path:
        """Return where an upload is kept.

        Raises:
            ImportFailed: there is no such upload.
        """
        with self._lock:
            upload = self._uploads.get(number)
        if upload is None:
            raise ImportFailed(str(number), Message("no-such-upload"))
        return upload.path

    def preview(self, number: int, mapping: ImportMapping, pick: Sequence[str], *, dbc: int | None) -> Preview:
        """Return the beginning of an upload as it would be understood.

        Args:
            number: of the upload.
            mapping: which columns, or signals of the DBC, are what.
            pick: quantities whose unit is to be taken from the names and values.
            dbc: the upload of it.

        Raises:
            ImportFailed: there is no such upload, or it cannot be read.
        """
        path, bus = self.path_of(number), None if dbc is None else self.path_of(dbc)
        return self._workers.run(INSPECTION, preview, path, mapping, tuple(pick), bus)

    def start(
        self,
        number: int,
        mapping: ImportMapping,
        *,
        dbc: int | None,
        name: str,
        started_unix_s: float | None = None,
        battery: str | None = None,
        battery_uploads: Sequence[int] = (),
    ) -> ImportState:
        """Begin to import an upload.

        Args:
            number: of the upload.
            mapping: which columns, or signals of the DBC, are what.
            dbc: the upload of it.
            name: of the session.
            started_unix_s: when it began; None: by the file.
            battery: a bundled battery's name.
            battery_uploads: a battery's profile first, then what it includes and its DBCs; counts more than `battery`.

        Raises:
            NotNow: another import is under way.
            ImportFailed: there is no such upload.
            ProfileError: the battery's profile cannot be used.
        """
        loaded = self._load(battery, battery_uploads)
        with self._lock:
            if self.state is not None and self.state.is_running:
                raise NotNow(Message("being-imported", filename=self.state.filename))
            upload = self._uploads.get(number)
            bus = None if dbc is None else self._uploads.get(dbc)
            if upload is None or (dbc is not None and bus is None):
                raise ImportFailed(str(number), Message("no-such-upload"))
            limits = import_limits(upload.path.stat().st_size)
            state = self.state = ImportState(upload.filename)
        is_log = upload.is_can and bus is None

        def progress(done: int, total: int) -> None:
            self.state = replace(state, done=done, total=total)

        self._workers.start(
            limits,
            import_file,
            upload.path,
            mapping,
            self._sessions,
            self._new_pipeline,
            battery=loaded or (self._battery if is_log else None),
            dbc=None if bus is None else bus.path,
            name=name,
            started_unix_s=started_unix_s,
            on_progress=progress,
        ).add_done_callback(partial(self._end, upload, state))
        return state

    def _load(self, name: str | None, uploads: Sequence[int]) -> LoadedBattery | None:
        """The battery that was named, or the one of uploaded files, side by side as their profile names them."""
        if not uploads:
            if name is not None and name not in bundled_profiles():
                raise ImportFailed(name, unknown_name(name, bundled_profiles()))
            return None if name is None else load_battery(name)
        with tempfile.TemporaryDirectory() as folder:
            with self._lock:
                paths = []
                for number in uploads:
                    if number not in self._uploads:
                        raise ImportFailed(str(number), Message("no-such-upload"))
                    paths.append(self._uploads[number].path)
                for path in paths:
                    shutil.copy(path, folder)
            return self._workers.run(DEFINITIONS, load_battery, str(Path(folder) / paths[0].name), own_folder=True)

    def _end(self, upload: Upload, started: ImportState, job: "Future[ImportedSession]") -> None:
        error = job.exception()
        if error is not None:  # whatever it is, the job ends and can be started again
            self.state = replace(started, is_running=False, error=message_of(error))
            failed = Message("import-failed", filename=upload.filename, error=message_of(error))
            self._note("warning", "import-failed", failed)
            return
        made = job.result()
        self.state = replace(
            started, is_running=False, done=made.rows, total=made.rows, session_id=made.info.id, notes=made.notes
        )
        with self._lock:
            self._uploads.pop(upload.id, None)
        self.discard(upload.path)
        self._note("info", "session-imported", Message("session-made", session=made.info.id, filename=upload.filename))
