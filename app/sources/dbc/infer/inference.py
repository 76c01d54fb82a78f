"""The profile that a DBC and received frames suggest, with reasons."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, cast

import numpy as np

from app.battery.battery import Battery, Limit, each_cell, spread, spread_in_packs
from app.battery.source import STATES, CellSignals, DbcMapping, StateSignal
from app.sources.dbc.assembly import PERIODS_BRIDGED
from app.sources.dbc.battery_decoder import BatteryDecoder, ChannelValues
from app.sources.dbc.current_sign import VoltageSeries, cell_means, cells_together
from app.sources.dbc.frames import Frames
from app.sources.dbc.infer.bus_survey import BusSurvey, words
from app.sources.dbc.infer.families import family_proposals
from app.sources.dbc.infer.frame_numbers import frame_number_proposals
from app.sources.dbc.infer.lines import Choice, ProfileLine, find_signal, line_of
from app.sources.dbc.infer.packs import packs_by_sender
from app.sources.dbc.infer.proposal import CellProposal
from app.sources.dbc.infer.readings import (
    ReadingProposal,
    charger_proposals,
    current_proposals,
    limit_proposals,
    pack_voltage_proposals,
    soc_proposals,
)
from app.sources.dbc.infer.states import Flow, StateProposal, state_proposals
from app.words import Message, Text

READINGS = ("current", "pack_voltage", "soc", "charger_voltage", "charger_current")
LIMITS_OF_CURRENT = ("discharge_current_max_a", "charge_current_max_a")
_MOST_CANDIDATES = 5  # candidates of a line
_LEAST_SCORE = {"voltage": 6.0, "temperature": 5.0}
_USUAL_PACKS = (12, 18, 14, 16, 15, 20, 24, 10, 28, 9, 8, 11, 13, 17, 21, 22, 23, 7, 6)


@dataclass(frozen=True, slots=True)
class InferredProfile:
    """A battery and its DBC mapping, as suggested and corrected; with reasons and questions."""

    battery: Battery
    source: DbcMapping
    lines: dict[str, ProfileLine]  # by key: voltage, temperature, current, ..., state.closed, ..., limit....
    questions: tuple[Text, ...]
    is_round_complete: bool = True  # every cell that frames number had its turn

    @property
    def voltage(self) -> CellProposal:
        """The proposal for cell voltages."""
        return cast("CellProposal", self.lines["voltage"].chosen)

    @property
    def temperature(self) -> CellProposal | None:
        """The proposal for temperatures."""
        line = self.lines.get("temperature")
        return cast("CellProposal", line.chosen) if line is not None and line.is_taken else None

    @property
    def readings(self) -> dict[str, ReadingProposal]:
        """Current, pack voltage, SOC and charger, as far as they are taken."""
        return {
            key: line.chosen
            for key, line in self.lines.items()
            if key in READINGS and line.is_taken and isinstance(line.chosen, ReadingProposal)
        }


def infer_profile(
    survey: BusSurvey,
    frames: Frames,
    name: str,
    dbc: tuple[str, ...],
    choices: Mapping[str, Choice] = MappingProxyType({}),
    segments: tuple[int, ...] = (),
    parallel: int = 1,
) -> InferredProfile | None:
    """Return the profile that is suggested, None where no cell voltages are found.

    Args:
        survey: messages and signals of the bus.
        frames: those of the survey.
        name: what people call the battery.
        dbc: the files of message definitions, as the profile names them.
        choices: what a person corrected, by the key of the line.
        segments: cells of each, where a person says it.
        parallel: cells in parallel that are measured as one.
    """
    proposals = [proposal for proposal in _ranked(survey, "voltage") if proposal.score >= _LEAST_SCORE["voltage"]]
    line = line_of("voltage", proposals[:_MOST_CANDIDATES], choices, survey.definitions)
    if line is None:
        return None
    questions: list[Text] = []
    voltage = cast("CellProposal", line.chosen)
    unit = _guessed_unit(voltage)
    if unit:
        voltage = replace(voltage, entries=tuple(replace(entry, unit=unit) for entry in voltage.entries))
        questions.append(Message("infer-unit-guessed", unit=unit))
    segments = segments or _segments(voltage, questions)
    used = _signals(voltage)
    temperatures = [
        proposal
        for proposal in _ranked(survey, "temperature")
        if proposal.score >= _LEAST_SCORE["temperature"]
        and not used & {(m.can_id, s.name) for m, s in proposal.members}
    ]
    lines = {"voltage": line}
    warm = line_of("temperature", temperatures[:_MOST_CANDIDATES], choices, survey.definitions)
    temperature = cast("CellProposal", warm.chosen) if warm is not None and warm.is_taken else None
    if temperature is None:
        questions.append(Message("infer-no-temperatures"))
    else:
        used |= _signals(temperature)
        if temperature.fit is not None and temperature.fit.others:  # 2950 is 22 degC in 0.1 K, 29.5 in 0.01 degC
            others = ", ".join(temperature.fit.others)
            questions.append(Message("infer-temperature-unit-guessed", unit=temperature.fit.unit, others=others))
    if warm is not None:
        lines["temperature"] = warm
    sensors = () if temperature is None else _sensors(temperature, segments)
    battery = Battery(name, segments, parallel, sensors=sensors)
    cells = {"voltage": voltage.entries} | ({} if temperature is None else {"temperature": temperature.entries})
    cells = {kind: _checked(survey, entries) for kind, entries in cells.items()}
    source = DbcMapping(dbc, cells)
    received = _decoded(survey, battery, source, frames)
    is_numbered = any(entry.numbers for entry in voltage.entries)
    is_round_complete = not is_numbered or _is_round_complete(received.get("voltage"))
    if is_numbered and "voltage" in received and not _came_round(received["voltage"]):
        questions.append(Message("infer-round-not-complete", n=battery.n_cells))
    sum_v = _sum_of_cells(received.get("voltage"), battery.n_cells)
    facts = _facts(received.get("voltage"), battery.n_cells)
    if voltage.segments is None and segments == _of_senders(voltage):
        facts.insert(0, Message("infer-senders", n=len(segments)))
    lines["voltage"] = replace(line, chosen=voltage.with_reason(*facts))
    _add_readings(lines, survey, received.get("voltage"), battery.n_cells, sum_v, used, choices)
    _add_states_and_limits(lines, survey, used, choices)
    current = lines.get("current")
    if current is None or not current.is_taken:
        questions.append(Message("infer-no-current"))
    elif isinstance(current.chosen, ReadingProposal) and not current.chosen.is_unit_given:
        questions.append(Message("infer-current-unit-guessed", name=str(current.chosen.reading.signal)))
    if current is not None and current.is_taken and len(frames):
        unknown = Message("infer-sign-unknown")
        questions += [unknown] if unknown in current.chosen.reasons else []
    return InferredProfile(*taken(battery, source, lines), lines, tuple(questions), is_round_complete)


def taken(battery: Battery, source: DbcMapping, lines: dict[str, ProfileLine]) -> tuple[Battery, DbcMapping]:
    """Return battery and source with what was taken of the lines."""
    readings: dict[str, Any] = {}
    states: dict[str, StateSignal] = {}
    limits: dict[str, Limit] = {}
    for key, line in lines.items():
        kind, _, name = key.rpartition(".")
        if not line.is_taken:
            continue
        if isinstance(line.chosen, StateProposal):
            states[name] = line.chosen.state
        elif isinstance(line.chosen, ReadingProposal) and kind == "limit":
            limits[name] = line.chosen.reading.signal
        elif isinstance(line.chosen, ReadingProposal):
            readings[key] = line.chosen.reading
    return replace(battery, limits=limits), replace(source, states=states, **readings)


def _add_readings(
    lines: dict[str, ProfileLine],
    survey: BusSurvey,
    voltages: ChannelValues | None,
    n_cells: int,
    sum_v: float,
    used: set[tuple[int, str]],
    choices: Mapping[str, Choice],
) -> None:
    packs = pack_voltage_proposals(survey, sum_v, used)
    currents = current_proposals(survey, _pack_voltage(survey, packs, voltages, n_cells), used)
    proposals_of: dict[str, list[ReadingProposal]] = {
        "current": currents,
        "pack_voltage": packs,
        "soc": soc_proposals(survey, used),
    }
    proposals_of |= {key: charger_proposals(survey, key, used) for key in ("charger_voltage", "charger_current")}
    for key, proposals in proposals_of.items():
        line = line_of(key, proposals[:_MOST_CANDIDATES], choices, survey.definitions)
        if line is not None:
            lines[key] = line


def _add_states_and_limits(
    lines: dict[str, ProfileLine], survey: BusSurvey, used: set[tuple[int, str]], choices: Mapping[str, Choice]
) -> None:
    current = lines.get("current")
    flow = None
    if current is not None and isinstance(current.chosen, ReadingProposal):
        named = find_signal(survey.definitions, str(current.chosen.reading.signal))
        flow = None if named is None else Flow.of(survey.signal(named[0], named[1].name))
    states = state_proposals(survey, flow, used)
    for name in STATES:
        line = line_of(f"state.{name}", states.get(name, [])[:_MOST_CANDIDATES], choices, survey.definitions)
        if line is not None:
            lines[line.key] = line
    for name in LIMITS_OF_CURRENT:
        proposals = limit_proposals(survey, name, used)[:_MOST_CANDIDATES]
        line = line_of(f"limit.{name}", proposals, choices, survey.definitions)
        if line is not None:
            lines[line.key] = line


def _signals(proposal: CellProposal) -> set[tuple[int, str]]:
    """The signals of a proposal, by id and name: of the values, and of the numbers that frames tell."""
    numbers = {name for entry in proposal.entries for name in entry.numbers.values()}
    return {(message.can_id, signal.name) for message, signal in proposal.members} | {
        (message.can_id, name) for message, _ in proposal.members for name in numbers
    }


def _segments(voltage: CellProposal, questions: list[Text]) -> tuple[int, ...]:
    segments = voltage.segments or _of_senders(voltage)
    if segments is None or sum(segments) != voltage.n or 0 in segments:
        segments = _guessed_packs(voltage.n)
        questions.append(Message("infer-segments-guessed", n=voltage.n, segments=len(segments)))
    return segments


def _of_senders(voltage: CellProposal) -> tuple[int, ...] | None:
    """Cells of each sender, as its entries take them: one entry as names number them, several in the order of ids."""
    in_order = list(voltage.members)
    if len(voltage.entries) > 1:
        in_order.sort(key=lambda member: member[0].can_id)
    return packs_by_sender(in_order)


def _guessed_unit(voltage: CellProposal) -> str:
    """A unit by name and number of bits, where neither the DBC nor a log tells one; "" where one does."""
    signal = voltage.members[0][1]
    if voltage.entries[0].unit or voltage.fit is not None or signal.unit or signal.layout.scale != 1.0:
        return ""
    if "mv" in words(signal.name):
        return "mV"
    return "0.1mV" if signal.layout.length >= 16 else "mV"


def _ranked(survey: BusSurvey, kind: str) -> list[CellProposal]:
    proposals = [*family_proposals(survey, kind), *frame_number_proposals(survey, kind)]
    return sorted(proposals, key=lambda proposal: -proposal.score)


def _guessed_packs(n: int) -> tuple[int, ...]:
    """Equal packs of a usual size."""
    for size in _USUAL_PACKS:
        if n % size == 0 and n > size:
            return (size,) * (n // size)
    return (n,)


def _sensors(temperature: CellProposal, segments: tuple[int, ...]) -> tuple[tuple[int, ...], ...]:
    n_cells = sum(segments)
    if temperature.n == n_cells:
        return each_cell(n_cells)
    if temperature.n % len(segments) == 0:
        return spread_in_packs(temperature.n, segments)
    return spread(temperature.n, range(n_cells))


def _checked(survey: BusSurvey, entries: tuple[CellSignals, ...]) -> tuple[CellSignals, ...]:
    """Entries with the checksum that every one of their frames has."""
    signals = []
    for entry in entries:
        message = next((m for m in survey.definitions.messages if m.name == entry.message), None)
        received = None if message is None else survey.of(message)
        if received is not None and any(
            "check" in s.name.lower() or "crc" in s.name.lower() for s in received.message.signals
        ):
            frames = received.group.frames
            total = (frames.can_id & 0x7FF).astype(np.int64) + frames.length + frames.data.sum(axis=1, dtype=np.int64)
            last = frames.data[:, 7].astype(np.int64)
            if frames.data.shape[1] == 8 and np.mean(((total - last) & 0xFF) == last) > 0.9:
                signals.append(replace(entry, checksum="orion"))
                continue
        signals.append(entry)
    return tuple(signals)


def _decoded(survey: BusSurvey, battery: Battery, source: DbcMapping, frames: Frames) -> dict[str, ChannelValues]:
    return BatteryDecoder(battery, source, survey.definitions).decode(frames) if len(frames) else {}


def _came_round(voltages: ChannelValues) -> bool:
    """Whether cells that frames number began anew: before, there may be more than were received."""
    return bool(np.any(np.diff(voltages.index) < 0))


def _is_round_complete(voltages: ChannelValues | None) -> bool:
    """Return whether the first cell that was received came once more, after others."""
    return voltages is not None and bool(np.any(np.diff((voltages.index == voltages.index[0]).astype(int)) > 0))


def _sum_of_cells(voltages: ChannelValues | None, n_cells: int) -> float:
    """Sum of all cells, by the mean of those that were received where nearly all were."""
    if voltages is None:
        return float("nan")
    means = cell_means(voltages, n_cells)
    is_finite = np.isfinite(means)
    return float(np.nanmean(means) * n_cells) if is_finite.mean() > 0.5 else float("nan")


def _pack_voltage(
    survey: BusSurvey, packs: list[ReadingProposal], voltages: ChannelValues | None, n_cells: int
) -> VoltageSeries | None:
    """The voltage over time: of the cells where they are fast, else of the pack."""
    if packs and packs[0].score > 4:
        name = packs[0].reading.signal
        for message in survey.definitions.messages:
            received = survey.signal(message, name.signal) if message.name == name.message else None
            if received is not None and np.std(received.values) > 0:
                return VoltageSeries(received.t_ns, received.values)
    return None if voltages is None else cells_together(voltages, n_cells)


def _facts(voltages: ChannelValues | None, n_cells: int) -> list[Text]:
    if voltages is None:
        return [Message("infer-nothing-received")]
    received = np.unique(voltages.index[np.isfinite(voltages.value)])
    facts: list[Text] = [Message("infer-cells-received", received=len(received), n=n_cells)]
    times = [voltages.t_ns[voltages.index == cell] for cell in received[:: max(1, len(received) // 20)]]
    gaps = [float(np.median(np.diff(t))) / 1e9 for t in times if len(t) > 1]
    if gaps:
        period_s = float(np.median(gaps))
        facts.append(Message("infer-period", period=f"{period_s:.3g}", age=f"{PERIODS_BRIDGED * period_s:.3g}"))
    return facts
