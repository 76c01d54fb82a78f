"""The facts of a session: rows of the tables `sessions`, `laps`, `cells` and `events`, out of what analysis finds."""

from __future__ import annotations

import json
from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from itertools import pairwise
from typing import Any, Final, get_args

import numpy as np

from app import __version__
from app.analysis.laps.figures import Lap, figures_of
from app.analysis.laps.from_session import find_laps
from app.analysis.limits import limits_of, limits_of_profile
from app.analysis.root_cause.from_session import incidents_of
from app.analysis.root_cause.kept_verdict import kept_verdicts
from app.analysis.session_cell import cell_of
from app.analysis.session_judge import cell_findings
from app.analysis.session_survey import read_pieces, read_totals
from app.analysis.survey import Rest, Survey, Surveyor, SurveyPiece
from app.battery.battery import Battery
from app.battery.library import file_name_of
from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import CellModel
from app.estimation.health.capacity import SOC_MOVED_MIN
from app.estimation.health.cell_finding import FindingCode
from app.season.estimates.session import SessionEstimate
from app.season.lake.cell_sums import CellSums, RestCounter, Stretch
from app.season.lake.schema import WHOLE
from app.sessions.reading.reader import SessionFile
from app.words import message_or_text, render

Row = dict[str, Any]
FILTER: Final = "fused"  # whose voltages tell how much more a cell resists than its model
_FINDING: Final = "finding-"
_FINDING_ENDED: Final = "finding-ended"
_OF_SURVEY: Final = (
    *("voltage_min_v", "voltage_max_v", "resistance_ohm", "resistance_sigma_ohm", "sag_v", "temperature_first_degc"),
    *("temperature_max_degc", "soc_first", "soc_last", "lowest_s", "balancing_s", "missing"),
)


@dataclass(frozen=True)
class Where:
    """The three values that stand in every row, and name a session's folder."""

    car: str
    season: str
    session: str


@dataclass(frozen=True)
class Facts:
    """Rows by table: each a dictionary by the names of `schema.TABLES`; NaN and None are null."""

    where: Where
    tables: Mapping[str, Sequence[Row]]


def where_of(session: SessionFile) -> Where:
    """Return whose session it is and of which season."""
    info = session.info
    year = str(_time(info.started_wall_ns / 1e9).year)
    season = file_name_of(str(info.metadata.get("season") or year))
    car = file_name_of(str(info.metadata.get("car") or session.battery.name))  # by `serve --car`
    if info.metadata.get("source") == "simulator":
        car += "-simulated"
    return Where(car, season, info.id)


def facts_of(session: SessionFile, *, judge_anew: bool = False) -> Facts:
    """Read a session and return what is to be known of it in a season.

    Findings are those of the recording; with `judge_anew` all cells are judged again, which takes
    about ten times as long and finds in old sessions what only newer versions know.

    Raises:
        NotASession: the file is damaged.
    """
    where = where_of(session)
    totals = read_totals(session)
    laps_from, laps = find_laps(session, totals, None, None)
    laps = sorted(laps, key=lambda lap: lap.start_s)
    cell, is_of_then = cell_of(session)
    stretches = _Stretches(session, laps, cell)
    for piece in read_pieces(session):
        stretches.add(piece)
    events = session.events()
    findings = _Findings(session, events, cell if judge_anew else None)
    survey = stretches.whole.surveyor.result()
    own = asdict(where)
    info = session.info
    return Facts(
        where,
        {
            "sessions": [
                own
                | {
                    "name": info.name,
                    "start_time": _time(info.started_wall_ns / 1e9),
                    "end_time": _time((info.ended_wall_ns or info.started_wall_ns) / 1e9),
                    "duration_s": info.duration_s,
                    "simulated": info.metadata.get("source") == "simulator",
                    "battery": session.battery.name,
                    "n_cells": session.battery.n_cells,
                    "segments": json.dumps(session.battery.segments),
                    "n_laps": sum(not lap.is_partial for lap in laps),
                    "laps_from": laps_from,
                    "cell_file": cell.name,
                    "cell_file_of_then": is_of_then,
                    "recorded_by": info.voltwall,
                    "metadata": json.dumps(dict(info.metadata), ensure_ascii=False),
                    "built_by": __version__,
                    **_of_session(survey),
                }
            ],
            "laps": [own | _lap(number, lap, figures_of(lap, totals)) for number, lap in enumerate(laps, 1)],
            "cells": [own | row for row in stretches.rows(findings)],
            "events": [own | _event(session, row, laps) for row in events],
        },
    )


class _Stretch:
    """A lap or the whole session, while its pieces come."""

    def __init__(self, battery: Battery, *, in_turns: bool) -> None:
        self.surveyor = Surveyor(battery.n_cells, in_turns=in_turns)
        self.sums = CellSums(battery.n_cells, battery.bleed_ohm)

    def add(self, piece: SurveyPiece, limits: Mapping[str, float]) -> None:
        self.surveyor.add(piece)
        self.sums.add(piece, limits)


class _Stretches:
    """Takes a session piece by piece and makes the rows of the table `cells`."""

    def __init__(self, session: SessionFile, laps: Sequence[Lap], cell: CellModel) -> None:
        battery = session.battery
        self._segments = battery.segments
        self._cell = cell
        self._laps = laps
        self._info = session.info
        in_force = [(session.unix_s(config.t_mono_ns), limits_of(config.image)) for config in session.configs()]
        self._in_force = in_force or [(0.0, limits_of_profile(battery))]
        in_turns = session.loaded_battery.mapping is not None
        self.whole = _Stretch(battery, in_turns=in_turns)
        self._of_lap = [_Stretch(battery, in_turns=in_turns) for _ in laps]
        self._estimate = SessionEstimate(cell, FILTER, battery.n_cells)
        self._rests = RestCounter(cell, battery.n_cells)
        edges = {edge for lap in laps for edge in (lap.start_s, lap.end_s)}
        self._edges_s = sorted(edges | {since_s for since_s, _ in self._in_force})

    def add(self, piece: SurveyPiece) -> None:
        """Take the next piece, cut where a lap or another configuration begins."""
        self._rests.add(piece)
        self._estimate.add(piece)
        self.whole.surveyor.add(piece)
        cuts = [0, *np.searchsorted(piece.time_s, self._edges_s).tolist(), len(piece.time_s)]
        for first, last in pairwise(cuts):
            if last > first:
                self._add_part(piece.rows(slice(first, last)))

    def _add_part(self, part: SurveyPiece) -> None:
        at_s = float(part.time_s[0])
        config = bisect_right(self._in_force, at_s, key=lambda entry: entry[0]) - 1
        limits = self._in_force[max(config, 0)][1]
        self.whole.sums.add(part, limits)
        lap = bisect_right(self._laps, at_s, key=lambda lap: lap.start_s) - 1
        if lap >= 0 and at_s < self._laps[lap].end_s:
            self._of_lap[lap].add(part, limits)

    def rows(self, findings: _Findings) -> Iterator[Row]:
        """Yield the rows: of the whole session, then of each lap."""
        start_s = self._info.started_wall_ns / 1e9
        survey = self.whole.surveyor.result()
        rests = self._of_rests(survey)
        finding_of = findings.by_cell(None, None)
        yield from self._stretch(WHOLE, start_s, self._info.duration_s, survey, self.whole, rests, finding_of)
        for number, (lap, stretch) in enumerate(zip(self._laps, self._of_lap, strict=True), 1):
            finding_of = findings.by_cell(lap.start_s, lap.end_s)
            yield from self._stretch(
                number, lap.start_s, lap.duration_s, stretch.surveyor.result(), stretch, {}, finding_of
            )

    def _stretch(
        self,
        number: int,
        start_s: float,
        duration_s: float,
        survey: Survey,
        stretch: _Stretch,
        rests: Mapping[str, Any],
        finding_of: Mapping[int, str],
    ) -> Iterator[Row]:
        columns = {name: getattr(survey, name) for name in _OF_SURVEY} | stretch.sums.columns() | dict(rests)
        columns["soc_used"] = survey.soc_first - survey.soc_last
        lists = {
            name: column.tolist() if isinstance(column, np.ndarray) else column for name, column in columns.items()
        }
        begin = _time(start_s)
        cell = 0
        for pack, n_cells in enumerate(self._segments, 1):
            for place in range(1, n_cells + 1):
                row: Row = {
                    "lap": number,
                    "cell": cell,
                    "pack": pack,
                    "cell_in_pack": place,
                    "start_time": begin,
                    "duration_s": duration_s,
                    "findings": finding_of.get(cell, ""),
                }
                row |= {name: facts[cell] if isinstance(facts, list) else facts for name, facts in lists.items()}
                row["missing"] = int(row["missing"])
                yield row
                cell += 1

    def _of_rests(self, survey: Survey) -> Row:
        factor, sigma = self._estimate.resistance()
        row: Row = {
            "resistance_factor": factor,
            "resistance_factor_sigma": np.where(np.isfinite(factor), sigma, np.nan),
        }
        for name, rest in (("first_rest", survey.first_rest), ("last_rest", survey.last_rest)):
            if rest is not None:
                row |= _rest(name, rest, self._cell)
        stretches = self._rests.stretches
        if stretches:
            row |= _counted(
                max(stretches, key=lambda stretch: float(np.nanmax(np.abs(stretch.soc_moved), initial=0.0)))
            )
        return row


class _Findings:
    """Findings of cells by time, from the session's events or judged again; of a cell that tripped, its verdict."""

    def __init__(self, session: SessionFile, events: Sequence[Mapping[str, Any]], judge: CellModel | None) -> None:
        self._findings = [
            (session.unix_s(row["t_mono_ns"]), int(row["cell"]), row["code"].removeprefix(_FINDING))
            for row in events
            if row["code"].startswith(_FINDING) and row["code"] != _FINDING_ENDED and row["cell"] is not None
        ]
        if judge is not None:
            self._findings = [
                (finding.since_s, finding.cell, finding.code) for finding in cell_findings(session, judge)
            ]
        kept = [verdicts[-1] for group in incidents_of(session) if (verdicts := kept_verdicts(session, group))]
        tripped = {
            cause.cell: cause for cause in kept if cause.cell is not None and cause.code in get_args(FindingCode)
        }
        self._findings = [finding for finding in self._findings if finding[1] not in tripped]
        self._findings += [(cause.since or cause.at, cell, cause.code) for cell, cause in tripped.items()]

    def by_cell(self, from_s: float | None, to_s: float | None) -> dict[int, str]:
        """Return the codes of each cell that first came in a range of unix time."""
        codes_of: dict[int, dict[str, None]] = {}
        for at_s, cell, code in self._findings:
            if (from_s is None or at_s >= from_s) and (to_s is None or at_s < to_s):
                codes_of.setdefault(cell, {})[code] = None
        return {cell: " ".join(codes) for cell, codes in codes_of.items()}


def _of_session(survey: Survey) -> Row:
    return {
        "driving_s": survey.driving_s,
        "energy_out_wh": survey.energy_out_wh if survey.has_energies else None,
        "energy_in_wh": survey.energy_in_wh if survey.has_energies else None,
        "charge_out_ah": survey.charge_out_ah,
        "charge_in_ah": survey.charge_in_ah,
        "current_max_a": survey.current_max_a if np.isfinite(survey.current_max_a) else None,
        "power_max_w": survey.power_max_w if np.isfinite(survey.power_max_w) else None,
    }


def _rest(name: str, rest: Rest, cell: CellModel) -> Row:
    return {
        f"{name}_time": _time(rest.time_s),
        f"{name}_v": rest.voltage_v,
        f"{name}_soc": cell.ocv.soc_at(rest.voltage_v),
    }


def _counted(stretch: Stretch) -> Row:
    """A capacity is charge over change of SOC; its relative variance is the sum of both relative variances."""
    moved, charge_ah = stretch.soc_moved, stretch.charge_ah
    tells = np.abs(moved) >= SOC_MOVED_MIN
    capacity_ah: FloatArray = np.where(tells, charge_ah / np.where(tells, moved, 1.0), np.nan)
    relative = np.hypot(stretch.charge_sigma_ah / abs(charge_ah or np.nan), stretch.soc_moved_sigma / np.abs(moved))
    return {
        "counted_soc": moved,
        "counted_soc_sigma": stretch.soc_moved_sigma,
        "counted_ah": charge_ah,
        "counted_ah_sigma": stretch.charge_sigma_ah,
        "capacity_ah": capacity_ah,
        "capacity_sigma_ah": np.abs(capacity_ah) * relative,
    }


def _lap(number: int, lap: Lap, figures: Any) -> Row:
    row = {name: value for name, value in vars(figures).items() if name != "lap"}
    return row | {
        "lap": number,
        "start_time": _time(lap.start_s),
        "duration_s": lap.duration_s,
        "driver": lap.driver,
        "note": lap.note,
        "counts": lap.counts,
    }


def _event(session: SessionFile, row: Mapping[str, Any], laps: Sequence[Lap]) -> Row:
    at_s = session.unix_s(row["t_mono_ns"])
    lap = bisect_right(laps, at_s, key=lambda lap: lap.start_s)
    inside = lap > 0 and at_s < laps[lap - 1].end_s
    text = render(message_or_text(row["text"], row.get("message")), session.battery.segments)
    kept = {name: row[name] for name in ("code", "severity", "cell", "value", "limit_value", "unit")}
    return kept | {"time": _time(at_s), "lap": lap if inside else None, "text": text}


def _time(unix_s: float) -> datetime:
    return datetime.fromtimestamp(unix_s, UTC)
