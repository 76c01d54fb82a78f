"""The evidence of a recorded reaction test: what the master is set to, what it measures, how fast it opened.

Everything comes out of the session: its frames, the configuration in force, and the markers that say which step ran
when. So it can be made again, by a later version too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final, Literal

import numpy as np

from app.analysis.evidence.master_samples import MasterSample, SampledValues, master_samples
from app.analysis.evidence.steps import STEPS, Cycles, Step
from app.analysis.evidence.timing import ClockRate, ConfiguredLimits, Missing, Timing, clock_rate, measure
from app.battery.shape import CELLS_PER_PACK
from app.errors import AppError
from app.estimation.cell_model.cell_file import bundled_cells, load_cell, parse_cell
from app.estimation.cell_model.circuit import CellModel
from app.sessions.info import Marker
from app.sessions.reading.reader import SessionFile
from app.words import Message
from firmware_protocol.config_image import image_hash, to_unit
from firmware_protocol.errors import DecodeError
from firmware_protocol.framing import BAUD_RATE, Frame, decode_chunk
from firmware_protocol.memory_map import CONFIG, MAP_HASH, T_MISSING, V_MISSING
from firmware_protocol.messages import Ident, MessageType, Reply

MARKER: Final = "evidence"  # kind of the markers: "STEP armed", "STEP done", "STEP skipped WHY"
METADATA: Final = "evidence"  # key of the test's record in the session's metadata
RULES_T_MAX_DEGC: Final = 60.0  # EV 5.8.5, or the data sheet's where that is lower
RULES_SHARE: Final = 0.3  # EV 5.8.3: of the cells with a temperature
Verdict = Literal["passed", "failed", "not-shown", "opened", "not-tested"]
Outcome = Literal["passed", "failed", "incomplete"]
Standing = Literal["within", "beyond", "pulses"]  # pulses: beyond what the data sheet allows for ever


class NoEvidence(AppError):
    """The session holds no reaction test."""

    def __init__(self, session: str) -> None:
        super().__init__(Message("no-evidence", session=session))


@dataclass(frozen=True)
class StepResult:
    """One step: `timing` where it was measured, else `why` not, or the crew's reason to skip it.

    `not-shown`: the limit lies inside the band. `opened`: it opened, and the rules name no time.
    """

    name: str
    rule: str
    allowed_s: float | None
    verdict: Verdict
    timing: Timing | None = None
    trip_fits: bool | None = None  # the master named this kind of fault
    why: Missing | None = None
    skipped: str = ""


@dataclass(frozen=True)
class LimitRow:
    """A limit in force against the data sheet's and the rules', in its unit; None where there is none."""

    name: str
    unit: str
    in_force: float
    sheet: float | None
    rules: float | None
    standing: Standing


@dataclass(frozen=True)
class Coverage:
    """Measured share of the sensors: the rules want all voltages, and temperatures of a share of every pack."""

    cells: int
    voltages: int
    temperatures: int
    least_share: float  # share of the pack with the fewest, 0..1
    rules_share: float
    is_enough: bool


@dataclass(frozen=True)
class Bytes:
    """Quality of the recording: frames, their interval and the master's clock."""

    frames: int
    bad: int
    lost: int
    interval_s: float  # median between two fast frames, on the master's clock
    line_s: float  # time of a fast frame on the line
    clock: ClockRate
    baud_rate: int


@dataclass(frozen=True)
class Evidence:
    """The document's data."""

    session_id: str
    tested: float  # unix time of the start [s]
    voltwall: str
    is_simulated: bool
    outcome: Outcome
    firmware: str | None
    protocol: int | None
    map_matches: bool | None
    url: str
    config_hash: str
    interval_s: float  # period of telemetry, as configured; the test may set it faster and back
    cell: str
    cycles: Cycles
    limits: list[LimitRow]
    coverage: Coverage
    steps: list[StepResult]
    bytes: Bytes


def cell_of_test(kept: str, source: str) -> CellModel:
    """Return the cell that a session keeps: a bundled name or a cell file's text, never a path of this machine.

    Raises:
        EstimatorError: it is neither.
    """
    return load_cell(kept) if kept in bundled_cells() else parse_cell(kept, source)


def evidence_of(session: SessionFile) -> Evidence:
    """Return the evidence in a session that `voltwall evidence` recorded.

    Raises:
        NoEvidence: it is another session, or holds no configuration or no frames.
        EstimatorError: the cell file that it keeps is wrong.
    """
    info = session.info
    metadata: Any = info.metadata.get(METADATA)
    configs, frames = session.configs(), list(session.frames())
    seen = master_samples([(frame.t_mono_ns, frame.raw) for frame in frames if frame.ok], BAUD_RATE)
    fast = [sample for sample in seen if sample.values is not None]
    if not isinstance(metadata, dict) or not configs or not fast:
        raise NoEvidence(info.id)
    image, cycles = configs[0].image, Cycles(**metadata["cycles"])
    cell = cell_of_test(str(metadata["cell"]), info.id)
    rate = clock_rate([sample for sample in seen if sample.boot == seen[0].boot])
    markers = [marker for marker in session.markers() if marker.kind == MARKER]
    ready_ns = markers[0].t_mono_ns if markers else fast[-1].arrived_ns
    healthy = [sample for sample in fast if sample.arrived_ns <= ready_ns][-1:] or fast[:1]
    rows, covered = limit_rows(image, cell), coverage(healthy[0].values)
    steps = _results(markers, seen, ConfiguredLimits.of(image), cycles, rate)
    ident = _ident([frame.raw for frame in frames if frame.ok])
    return Evidence(
        session_id=info.id,
        tested=info.started_wall_ns / 1e9,
        voltwall=info.voltwall,
        is_simulated=bool(metadata["is_simulated"]),
        outcome=_outcome(steps, rows, covered),
        firmware=None if ident is None else ".".join(map(str, ident.firmware)),
        protocol=None if ident is None else ident.protocol,
        map_matches=None if ident is None else ident.map_hash == MAP_HASH,
        url=str(metadata["url"]),
        config_hash=image_hash(image),
        interval_s=CONFIG["telemetry_period"].unpack(image)[0] / 1000,
        cell=cell.name,
        cycles=cycles,
        limits=rows,
        coverage=covered,
        steps=steps,
        bytes=_bytes(fast, seen, len(frames), rate),
    )


def _results(
    markers: Sequence[Marker], seen: Sequence[MasterSample], limits: ConfiguredLimits, cycles: Cycles, rate: ClockRate
) -> list[StepResult]:
    results: dict[str, StepResult] = {}
    armed_ns: dict[str, int] = {}
    steps = {step.name: step for step in STEPS}
    for marker in markers:
        name, _, rest = marker.text.partition(" ")
        if name not in steps:
            continue
        step = steps[name]
        if rest == "armed":
            armed_ns[name] = marker.t_mono_ns
        elif rest == "done":
            part = [sample for sample in seen if armed_ns[name] <= sample.arrived_ns <= marker.t_mono_ns]
            results[name] = judge(step, measure(part, step.name, limits, cycles, rate))
        else:
            results[name] = StepResult(
                step.name, step.rule, step.allowed_s, "not-tested", skipped=rest.removeprefix("skipped").strip()
            )
    return [results.get(step.name, StepResult(step.name, step.rule, step.allowed_s, "not-tested")) for step in STEPS]


def judge(step: Step, measured: object) -> StepResult:
    """Return a step's result: passed where even the latest time of the band is in time, failed where none is."""
    if not isinstance(measured, Timing):
        why: Missing = measured.why  # type: ignore[attr-defined]
        failed = why == "not-opened" or why == "not-seen"
        return StepResult(step.name, step.rule, step.allowed_s, "failed" if failed else "not-tested", why=why)
    allowed_s, verdict = step.allowed_s, "opened"
    if allowed_s is not None:
        late = "failed" if measured.low_s > allowed_s else "not-shown"
        verdict = "passed" if measured.high_s <= allowed_s else late
    fits = None if measured.trip is None else measured.trip in step.trips
    return StepResult(step.name, step.rule, allowed_s, verdict, measured, fits)  # type: ignore[arg-type]


def _outcome(steps: Sequence[StepResult], limits: Sequence[LimitRow], covered: Coverage) -> Outcome:
    verdicts = {step.verdict for step in steps}
    is_beyond = any(row.standing == "beyond" for row in limits)
    if is_beyond or not covered.is_enough or verdicts & {"failed", "not-shown"}:
        return "failed"
    return "incomplete" if "not-tested" in verdicts else "passed"


def limit_rows(image: bytes, cell: CellModel) -> list[LimitRow]:
    """Return the active limits with those of the data sheet and of the rules."""
    sheet = cell.limits
    t_rule = (
        RULES_T_MAX_DEGC if sheet.temperature_max_degc is None else min(RULES_T_MAX_DEGC, sheet.temperature_max_degc)
    )
    charge_a = None if sheet.charge_max_a is None else -sheet.charge_max_a
    rows = (
        ("v_cell_max", cell.v_max_v, None, 1),
        ("v_cell_min", cell.v_min_v, None, -1),
        ("t_cell_max", sheet.temperature_max_degc, t_rule, 1),
        ("t_cell_min", sheet.temperature_min_degc, None, -1),
        ("i_disc_max", sheet.discharge_max_a, None, 1),
        ("i_disc_min", charge_a, None, -1),
        ("i_chrg_max", sheet.charge_max_a, None, 1),
    )
    limits_of_rows = []
    for name, of_sheet, of_rules, sense in rows:
        field = CONFIG[name]
        value = float(to_unit(field, field.unpack(image)[0]))
        standing: Standing = "within"
        if any(sense * value > sense * limits for limits in (of_sheet, of_rules) if limits is not None):
            standing = "pulses" if name.startswith("i_disc") else "beyond"
        limits_of_rows.append(LimitRow(name, field.unit, value, of_sheet, of_rules, standing))
    return limits_of_rows


def coverage(values: SampledValues | None) -> Coverage:
    """Return how many cells have a voltage and a temperature, and the share in the pack with the fewest."""
    if values is None:
        raise ValueError("no fast frame")
    known_v, known_t = values.voltage != V_MISSING, values.temperature != T_MISSING
    least = float(known_t.reshape(-1, CELLS_PER_PACK).mean(axis=1).min())
    n = len(known_v)
    return Coverage(
        n, int(known_v.sum()), int(known_t.sum()), least, RULES_SHARE, bool(known_v.all()) and least >= RULES_SHARE
    )


def _ident(raw: Sequence[bytes]) -> Ident | None:
    for chunk in raw:
        frame = decode_chunk(chunk)
        if isinstance(frame, Frame) and frame.type == MessageType.REPLY:
            try:
                reply = Reply.from_body(frame.body)
                if reply.request_type == MessageType.IDENT:
                    return Ident.from_bytes(reply.data)
            except DecodeError:
                continue
    return None


def _bytes(fast: Sequence[MasterSample], seen: Sequence[MasterSample], n_frames: int, rate: ClockRate) -> Bytes:
    lost = sum(
        (after.sequence - before.sequence - 1) & 0xFF for before, after in pairwise(seen) if before.boot == after.boot
    )
    apart = np.diff([sample.uptime_ms for sample in fast]) if len(fast) > 1 else np.zeros(1)
    line_s = float(np.median([sample.line_s for sample in fast]))
    return Bytes(len(seen), n_frames - len(seen), lost, float(np.median(apart)) / 1000, line_s, rate, BAUD_RATE)
