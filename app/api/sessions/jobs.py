"""Jobs over a whole session, by the path of its file: for a process of its own, which is handed no open file."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Concatenate, ParamSpec, TypeVar

from app.analysis.laps.from_session import Counter, Overlay, Source, lap_table, lap_times, overlay_laps
from app.analysis.report.report import SessionComparison, compare_sessions
from app.sessions.export.export import export
from app.sessions.export.formats import FORMATS, Names
from app.sessions.reading.reader import SessionFile

P = ParamSpec("P")
T = TypeVar("T")


def of_session(path: Path, make: Callable[Concatenate[SessionFile, P], T], *args: P.args, **named: P.kwargs) -> T:
    """Return what a function makes of a session, or raise what it raises."""
    with SessionFile(path) as file:
        return make(file, *args, **named)


def comparison_at(first: Path, second: Path) -> SessionComparison:
    """Return two sessions side by side."""
    with SessionFile(first) as one, SessionFile(second) as other:
        return compare_sessions(one, other)


def overlay_at(
    path: Path,
    source: Source | None,
    counter: Counter | None,
    laps: Sequence[int],
    signal: str,
    points: int,
    along: str | None,
) -> Overlay:
    """Return one signal over some laps.

    Raises:
        UnknownSignal: there is no such signal.
    """
    with SessionFile(path) as file:
        table = lap_table(file, source, counter)
        return overlay_laps(file, [lap.lap for lap in table.laps], laps, signal, points, along)


def export_at(
    path: Path,
    target: Path,
    export_format: str,
    signals: Sequence[str] | None,
    t_from_s: float | None,
    t_to_s: float | None,
    names: Names,
) -> bool:
    """Write signals of a session into another format's file; tell whether the car was a simulated one.

    Raises:
        ConfigError: the format has nothing to tell, or no such names.
        UnknownSignal: a name means nothing.
        ExportUnavailable: the format needs a package that is not installed.
    """
    with SessionFile(path) as file:
        laps = lap_times(file) if FORMATS[export_format].has_laps else None
        export(
            file,
            target,
            export_format,
            signals=signals,
            t_from_s=t_from_s,
            t_to_s=t_to_s,
            lap_times_s=laps,
            names=names,
        )
        return file.info.metadata.get("source") == "simulator"
