"""What is made of a whole session, by the path of its file: for a process of its own, which is handed no open file."""

from collections.abc import Sequence
from pathlib import Path

from app.analysis.evidence.evidence import Evidence, evidence_of
from app.analysis.laps.from_session import Counter, LapTable, Overlay, Source, lap_table, lap_times, overlay_laps
from app.analysis.report.report import Report, SessionComparison, compare_sessions, report_of
from app.sessions.export.export import export
from app.sessions.export.formats import FORMATS, Names
from app.sessions.reading.reader import SessionFile


def report_at(path: Path) -> Report:
    """Return a session's report."""
    with SessionFile(path) as file:
        return report_of(file)


def comparison_at(first: Path, second: Path) -> SessionComparison:
    """Return two sessions side by side."""
    with SessionFile(first) as one, SessionFile(second) as other:
        return compare_sessions(one, other)


def evidence_at(path: Path) -> Evidence:
    """Return what a session proves of the reaction times.

    Raises:
        NoEvidence: it proves nothing.
    """
    with SessionFile(path) as file:
        return evidence_of(file)


def laps_at(path: Path, source: Source | None, counter: Counter | None) -> LapTable:
    """Return a session's laps.

    Raises:
        UnknownSignal: there is no such signal.
    """
    with SessionFile(path) as file:
        return lap_table(file, source, counter)


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
        return overlay_laps(file, [each.lap for each in table.laps], laps, signal, points, along)


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
