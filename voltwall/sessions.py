"""Recorded sessions."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from app.analysis.laps.from_session import lap_table
from app.analysis.session_cell import cell_of
from app.analysis.session_judge import cell_findings
from app.errors import ConfigError, ExtraMissing
from app.estimation.arrays import FloatArray
from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimates import Estimates
from app.season.estimates.session import estimate_along
from app.sessions.errors import SessionNotFound
from app.sessions.export.table import SignalTable
from app.sessions.reading.reader import SessionFile
from app.sessions.transfer.fetch import Remote
from app.telemetry.cell_findings import finding_of
from app.words import message_or_text, render
from voltwall.records import Event, Finding, Lap
from voltwall.tables import Closing, Table, over_time

if TYPE_CHECKING:
    import pyarrow

_OF_SERVICE = re.compile(r"(?P<service>https?://[^/]+)/(api/v1/)?sessions/(?P<session>[^/?#]+)")


def open(where: str | Path, *, password: str | None = None, trust: str | None = None) -> Session:
    """Open a recorded session.

    Args:
        where: its file; `http://HOST:8000/sessions/ID` of a running service, which sends the file; or any URL of
            fsspec, as `s3://team/20260714T103000Z.sqlite`.
        password: of the service, its viewer's or engineer's, or a token.
        trust: its certificate, see `voltwall.connect`.

    Raises:
        VoltwallError: it is not there, or no session, or was written by a newer version.
    """
    text = str(where)
    if "://" not in text:
        return Session(Path(text).expanduser())
    folder = Path(tempfile.mkdtemp(prefix="voltwall-"))
    try:
        return Session(_brought(text, folder, password, trust), folder)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise


def _brought(url: str, folder: Path, password: str | None, trust: str | None) -> Path:
    """Bring the file of a session into a folder."""
    if (of_service := _OF_SERVICE.match(url)) is not None:
        remote = Remote(of_service["service"], password=password, trust=trust)
        sessions = [session for session in remote.sessions() if session.id == of_service["session"]]
        if not sessions:
            raise SessionNotFound(of_service["session"])
        return remote.fetch(sessions[0], folder)
    try:
        import fsspec
    except ImportError as error:
        raise ExtraMissing("URL", "fsspec", "season") from error
    path = folder / url.rpartition("/")[2]
    try:
        with fsspec.open(url, "rb") as source, path.open("wb") as target:
            shutil.copyfileobj(source, target)
    except (OSError, ImportError, ValueError) as error:
        raise ConfigError("session", url, str(error) or type(error).__name__) from error
    return path


class Session(Closing):
    """A recorded session, open for reading. Nothing is changed in it. Close it, or use `with`."""

    def __init__(self, path: Path, temporary: Path | None = None) -> None:
        self._file = SessionFile(path)
        self._temporary = temporary

    def __repr__(self) -> str:
        return f"<voltwall.Session {self.id}, {self.duration_s:.0f} s, {self.n_cells} cells>"

    def close(self) -> None:
        """Close the file; one that was brought from elsewhere is removed."""
        self._file.close()
        if self._temporary is not None:
            shutil.rmtree(self._temporary, ignore_errors=True)

    @property
    def id(self) -> str:
        """Name of the session's file."""
        return self._file.info.id

    @property
    def name(self) -> str:
        """Return its name."""
        return self._file.info.name

    @property
    def start(self) -> datetime:
        """Return its start, in UTC."""
        return _utc(self._file.info.started_wall_ns / 1e9)

    @property
    def duration_s(self) -> float:
        """Return its length [s]."""
        return self._file.info.duration_s

    @property
    def metadata(self) -> Mapping[str, Any]:
        """Return the metadata noted while it was recorded: event, driver, source and the like."""
        return dict(self._file.info.metadata)

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return self._file.battery.n_cells

    @property
    def segments(self) -> tuple[int, ...]:
        """Cells of each pack."""
        return self._file.battery.segments

    @cached_property
    def signals(self) -> Mapping[str, str]:
        """Unit of every signal that was recorded, by name, as `{"v[36]": "V"}`."""
        signals = self._file.signals
        names = [name for field in self._file.signal_names() for name in signals.names(field)]
        return {name: signals.find(name).unit for name in names}

    def to_arrow(
        self, *names: str, start: datetime | float | None = None, end: datetime | float | None = None
    ) -> pyarrow.Table:
        """Return signals over time, a row for each instant at which one was sampled; null where it was not.

        Args:
            names: signals, as `v[36]`, or whole fields, as `v`, `t`, `i_fs`, `estimate.soc`. Without names: voltages,
                temperatures, current, and the estimates.
            start: of the range, in UTC, or in seconds from the session's start.
            end: likewise, included.

        Raises:
            VoltwallError: no such signal; pyarrow is not installed.
        """
        return self.table(*names, start=start, end=end).arrow

    def to_pandas(self, *names: str, start: datetime | float | None = None, end: datetime | float | None = None) -> Any:
        """Return the same as a pandas DataFrame with a DatetimeIndex in UTC; see `to_arrow`."""
        return self.table(*names, start=start, end=end).to_pandas()

    def to_polars(self, *names: str, start: datetime | float | None = None, end: datetime | float | None = None) -> Any:
        """Return the same as a Polars DataFrame; see `to_arrow`."""
        return self.table(*names, start=start, end=end).to_polars()

    def table(self, *names: str, start: datetime | float | None = None, end: datetime | float | None = None) -> Table:
        """Return the same as a `Table`; see `to_arrow`."""
        signals = self._file.signals
        wanted = [
            wanted_name for name in names for wanted_name in (signals.names(name) if name in signals.order else [name])
        ]
        chosen = SignalTable(self._file, wanted or None, self._unix_s(start), self._unix_s(end))
        shown = [k for k, signal in enumerate(chosen.signals) if signal.field in signals.order]
        rows = list(chosen.rows())
        time_s = np.concatenate([np.empty(0), *(row.time_s for row in rows)])
        values = np.concatenate([np.empty((0, len(shown))), *(row.values[:, shown] for row in rows)])
        columns = [chosen.signals[k] for k in shown]
        return over_time(time_s, [column.name for column in columns], [column.unit for column in columns], values)

    @property
    def laps(self) -> list[Lap]:
        """Its laps: as somebody settled them, by markers, or by the pattern of the power."""
        return [
            Lap(
                number,
                _utc(lap.lap.start_s),
                _utc(lap.lap.end_s),
                lap.lap.driver,
                lap.lap.counts,
                lap.energy_out_wh,
                lap.energy_in_wh,
                lap.power_mean_w,
                lap.power_max_w,
                lap.soc_used,
                lap.temperature_max_degc,
                lap.temperature_max_cell,
                lap.voltage_min_v,
                lap.weakest_cell,
                lap.lap.is_partial,
            )
            for number, lap in enumerate(lap_table(self._file).laps, 1)
        ]

    @property
    def events(self) -> list[Event]:
        """Its events, in order."""
        return [
            Event(
                _utc(self._file.unix_s(row["t_mono_ns"])),
                row["code"],
                row["severity"],
                render(message_or_text(row["text"], row.get("message")), self.segments),
                row["cell"],
                row["value"],
                row["limit_value"],
                row["unit"],
            )
            for row in self._file.events()
        ]

    @property
    def findings(self) -> list[Finding]:
        """Return the faults of its cells at its end, the surest first, judged by this version; takes seconds."""
        judged = [finding_of(finding) for finding in cell_findings(self._file)]
        return [
            Finding(
                finding.code,
                finding.cell,
                finding.size,
                finding.low,
                finding.high,
                finding.unit,
                _utc(finding.since),
                finding.confidence,
                render(finding.message, self.segments),
            )
            for finding in judged
        ]

    def estimate(self, cell: str | Path | None = None, filter: str = "fused") -> Estimate:
        """Run a filter over the session again.

        Args:
            cell: a cell file, or the name of a bundled cell; None: the one that the session was recorded with.
            filter: `fused`, `coulomb`, `ekf`, `ukf` or `cdkf`.

        Raises:
            VoltwallError, ValueError: the cell file is wrong, or there is no such filter.
        """
        times: list[FloatArray] = []
        states: list[FloatArray] = []

        def keep(time_s: FloatArray, estimates: Estimates) -> None:
            times.append(np.array(time_s))
            states.append(np.hstack([estimates.soc, estimates.soc_sigma]))

        model = cell_of(self._file)[0] if cell is None else load_cell(cell)
        summary = estimate_along(self._file, model, filter, keep)
        n = self.n_cells
        names = [f"{name}[{k}]" for name in ("soc", "soc_sigma") for k in range(n)]
        time_s = np.concatenate([np.empty(0), *times])
        values = np.concatenate([np.empty((0, 2 * n)), *states])
        return Estimate(over_time(time_s, names, ["1"] * 2 * n, values), model.name, filter, summary)

    def _unix_s(self, at: datetime | float | None) -> float | None:
        if at is None:
            return None
        if isinstance(at, datetime):
            return (at if at.tzinfo else at.replace(tzinfo=UTC)).timestamp()
        return self._file.info.started_wall_ns / 1e9 + float(at)


@dataclass(frozen=True)
class Estimate:
    """The estimates of a session by one filter.

    Attributes:
        table: `soc[0]`, ... and `soc_sigma[0]`, ... over `time`.
        cell: name of the cell model.
        filter: name of the filter.
        summary: figures of the whole session: `soc_last`, `capacity_ah`, `resistance_factor`, `innovation_rms_v` and
            others, lists of one value a cell.
    """

    table: Table
    cell: str
    filter: str
    summary: Mapping[str, Any]

    def to_arrow(self) -> pyarrow.Table:
        """Return the table as a pyarrow table."""
        return self.table.to_arrow()

    def to_pandas(self) -> Any:
        """Return the table as a pandas DataFrame over time."""
        return self.table.to_pandas()

    def to_polars(self) -> Any:
        """Return the table as a Polars DataFrame."""
        return self.table.to_polars()


def _utc(unix_s: float) -> datetime:
    return datetime.fromtimestamp(unix_s, UTC)
