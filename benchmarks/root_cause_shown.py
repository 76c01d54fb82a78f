"""The cause of a trip in each place that shows it, whether it is right, and whether all places agree.

Places: the banner (the trip's alarm in the live snapshot), the cell's findings in that snapshot, the black box, the
report, and both again on the command line. The recording judged afterwards is its file without the kept verdicts.
"""

from __future__ import annotations

import contextlib
import io
import json
import shutil
import sqlite3
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, get_args

from app.analysis.root_cause.from_session import causes_of
from app.analysis.root_cause.judge import SAME
from app.cli import main as command_line
from app.estimation.health.cell_finding import FindingCode
from app.sessions.reading.reader import SessionFile
from benchmarks.root_cause_runs import JOINT, Case, Drawn
from tests.recorded.service_car import Car

UNKNOWN: Final = "unknown"
KEPT: Final = "run.json"
EXPLAINED_S: Final = 5.0  # between two looks whether a trip is
CELL_CODES: Final = get_args(FindingCode)
# What shows a kind that trips nothing, where its alarm has not the kind's own name
ALARMS: Final[dict[str, tuple[str, ...]]] = {}


@dataclass(frozen=True)
class Named:
    """A cause as it was named somewhere."""

    code: str
    cell: int | None = None
    pack: int | None = None
    size: float | None = None
    low: float | None = None
    high: float | None = None
    judged: float | None = None

    @property
    def place(self) -> str:
        """Code and place, for a list of misses."""
        return f"{self.code}@{self.cell if self.cell is not None else self.pack}"


@dataclass(frozen=True)
class Run:
    """The causes named in one run.

    Attributes:
        recorded: causes by the session's file alone, the first trip's first.
        live: the verdict of the first trip, None: nothing tripped.
        alarms: what the live service warned of, code and cell.
        page: what the page of the faulty cell shows at the end.
        apart: the places that show another cause of a trip than its black box does; None: nothing tripped.
    """

    case: Case
    recorded: list[Named]
    live: Named | None
    alarms: list[Named]
    page: Named | None
    apart: list[str] | None

    @property
    def has_band(self) -> bool | None:
        """The band on the cell's page holds the true size; None: it is not a joint."""
        if self.case.fault != JOINT or self.case.value is None:
            return None
        page = self.page
        return page is not None and (page.low or 0.0) <= 1e-3 * self.case.value <= (page.high or 0.0)

    @property
    def is_right_recorded(self) -> bool:
        """The first cause by the file is the right one; of a healthy run: there is none."""
        if self.case.part == "healthy":
            return not self.recorded
        return bool(self.recorded) and is_right(self.case, self.recorded[0])

    @property
    def is_right_live(self) -> bool:
        """So is the verdict that was made at the trip; without a trip an alarm says so."""
        if self.case.part == "healthy":
            return self.live is None and not any(alarm.code in CELL_CODES for alarm in self.alarms)
        if self.live is not None:
            return is_right(self.case, self.live)
        return any(is_right(self.case, alarm) for alarm in self.alarms)


def is_right(case: Case, named: Named) -> bool:
    """The right code, or one that contains it, at the right place."""
    codes = (named.code, *SAME.get(named.code, ()))
    if case.fault not in codes and named.code not in ALARMS.get(case.fault, ()):
        return False
    if case.cell is not None:
        return named.cell == case.cell
    return case.pack is None or named.pack in (None, case.pack)


def play(drawn: Drawn, folder: Path) -> Run:
    """Play a run in a data folder of its own, and ask every place; one that was played before is read."""
    case, scenario = drawn
    data = folder / case.name
    if (kept := kept_run(data)) is not None:
        return kept
    shutil.rmtree(data, ignore_errors=True)
    with Car(data, scenario) as car:
        _run(car)
        session_id = car.end_recording()
        run = asked(case, data, session_id, car.banners, car.get)
    keep_run(data, run)
    return run


def _run(car: Car) -> None:
    """Play a scenario to its end, or until a trip is explained: nothing that comes later is asked about."""
    is_explained = False
    while not car.player.is_over and not is_explained:
        is_explained = any(map(_explains, car.banners))
        car.run(EXPLAINED_S)


def _explains(banner: dict[str, Any]) -> bool:
    causes = [alarm["cause"] for alarm in banner["alarms"] if alarm["severity"] == "trip"]
    return any(cause is not None and cause["code"] != UNKNOWN for cause in causes)


def kept_run(data: Path) -> Run | None:
    """Return what `keep_run` kept in a data folder."""
    kept = data / KEPT
    if not kept.exists():
        return None
    body = json.loads(kept.read_text())
    recorded, alarms = ([Named(**cause) for cause in body[name]] for name in ("recorded", "alarms"))
    live, page = (None if body[name] is None else Named(**body[name]) for name in ("live", "page"))
    return Run(Case(**body["case"]), recorded, live, alarms, page, body["apart"])


def keep_run(data: Path, run: Run) -> None:
    """Keep a run with its data, for a later call."""
    (data / KEPT).write_text(json.dumps(asdict(run)))


def asked(case: Case, data: Path, session_id: str, banners: Sequence[dict[str, Any]], get: Callable[[str], Any]) -> Run:
    """Ask a service and the command line about a session that has ended, and judge its file again."""
    listed = reversed(get(f"/sessions/{session_id}/blackboxes")["boxes"])
    trips = [get(f"/blackboxes/{box['id']}") for box in listed if box["severity"] == "trip"]
    causes = [box["cause"] for box in trips if box["cause"] is not None]
    apart = None
    if trips:
        reports = {"report": get(f"/sessions/{session_id}/report")["causes"]}
        reports["command line, report"] = command(data, "report", session_id)["causes"]
        boxes = [box["cause"] for box in command(data, "blackbox", session_id) if box["severity"] == "trip"]
        reports["command line, black box"] = [cause for cause in boxes if cause is not None]
        apart = sorted({*_apart(causes, reports), *(place for cause in causes for place in _not_live(cause, banners))})
    path = data / "sessions" / f"{session_id}.sqlite"
    return Run(
        case,
        recorded=judged_anew(path),
        live=_named(causes[0]) if causes else None,
        alarms=_alarms(get("/events?limit=500")["events"]),
        page=_page(case, get("/snapshot")),
        apart=apart,
    )


def command(data: Path, *words: str) -> Any:
    """Return what a command on the data folder prints as JSON."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(io.StringIO()):
        command_line(("sessions", *words, "--data", str(data), "--json"))
    return json.loads(printed.getvalue())


def judged_anew(path: Path) -> list[Named]:
    """Return the causes by a session's file without the verdicts that it keeps."""
    copy = path.with_suffix(".copy.sqlite")
    with contextlib.closing(sqlite3.connect(path)) as kept, contextlib.closing(sqlite3.connect(copy)) as database:
        kept.backup(database)  # with what is not in the file itself yet
        database.execute("DELETE FROM notes WHERE key LIKE 'verdict %'")
        database.commit()
    with warnings.catch_warnings(), SessionFile(copy) as session:
        warnings.simplefilter("ignore")
        causes = causes_of(session)
    copy.unlink()
    return [_named(asdict(cause)) for cause in causes]


def _page(case: Case, snapshot: dict[str, Any]) -> Named | None:
    findings = [
        finding for finding in snapshot["findings"] if finding["cell"] == case.cell and finding["code"] == case.fault
    ]
    return _named(findings[0] | {"pack": case.pack, "judged": None}) if findings else None


def _named(cause: dict[str, Any]) -> Named:
    return Named(*(cause[name] for name in ("code", "cell", "pack", "size", "low", "high", "judged")))


def _apart(causes: Sequence[dict[str, Any]], places: dict[str, list[dict[str, Any]]]) -> Iterable[str]:
    """The places where one of these verdicts is missing."""
    for place, shown in places.items():
        listed = [_named(cause) for cause in shown]
        if any(_named(cause) not in listed for cause in causes):
            yield place


def _not_live(cause: dict[str, Any], banners: Sequence[dict[str, Any]]) -> Iterable[str]:
    """Whether banner and findings of the cell showed this verdict."""
    named = _named(cause)
    showing = [
        banner
        for banner in banners
        if any(alarm["cause"] is not None and _named(alarm["cause"]) == named for alarm in banner["alarms"])
    ]
    if not showing:
        yield "banner"
    elif named.cell is not None and named.code != UNKNOWN:
        findings = [finding for finding in showing[0]["findings"] if finding["cell"] == named.cell]
        expected = [named.code] if named.code in CELL_CODES else []
        same_size = all(named.size is None or finding["size"] == named.size for finding in findings)
        if [finding["code"] for finding in findings] != expected or not same_size:
            yield "cell"


def _alarms(events: Iterable[dict[str, Any]]) -> list[Named]:
    """What was warned of, each once."""
    warned = [event for event in events if event["severity"] != "info"]
    return list(dict.fromkeys(Named(event["code"].removeprefix("finding-"), event["cell"]) for event in warned))
