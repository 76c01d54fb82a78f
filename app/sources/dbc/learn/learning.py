"""The profile that a DBC and what is heard suggest, with what speaks for it."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from app.battery.battery import Battery, each_cell, spread, spread_in_segments
from app.battery.source import CellSignals, SpeaksDbc
from app.sources.dbc.assembly import PERIODS_BRIDGED
from app.sources.dbc.battery_decoder import BatteryDecoder, Values
from app.sources.dbc.frames import Frames
from app.sources.dbc.learn.families import family_proposals
from app.sources.dbc.learn.frame_numbers import frame_number_proposals
from app.sources.dbc.learn.proposal import CellProposal
from app.sources.dbc.learn.readings import (
    PackVoltage,
    ReadingProposal,
    current_proposals,
    pack_voltage_proposals,
    soc_proposals,
)
from app.sources.dbc.learn.survey import Survey
from app.sources.dbc.learn.words_of_names import words
from app.words import Message, Text

_LEAST_SCORE = {"voltage": 6.0, "temperature": 5.0}
_USUAL_SEGMENTS = (12, 18, 14, 16, 15, 20, 24, 10, 28, 9, 8, 11, 13, 17, 21, 22, 23, 7, 6)


@dataclass(frozen=True, slots=True)
class Learned:
    """A battery and how it speaks, as suggested; with reasons and doubts."""

    battery: Battery
    source: SpeaksDbc
    voltage: CellProposal
    temperature: CellProposal | None
    readings: dict[str, ReadingProposal]
    others: dict[str, tuple[CellProposal | ReadingProposal, ...]]  # what else could be meant, the best first
    doubts: tuple[Text, ...]


def learn(survey: Survey, frames: Frames, name: str, dbc: tuple[str, ...]) -> Learned | None:
    """Return the profile that is suggested, None where no cell voltages are found."""
    voltages = _ranked(survey, "voltage")
    if not voltages or voltages[0].score < _LEAST_SCORE["voltage"]:
        return None
    voltage = voltages[0]
    doubts: list[Text] = []
    unit = _guessed_unit(voltage)
    if unit:
        voltage = replace(voltage, entries=tuple(replace(entry, unit=unit) for entry in voltage.entries))
        doubts.append(Message("learn-unit-guessed", unit=unit))
    segments = voltage.segments
    if segments is None or sum(segments) != voltage.n or 0 in segments:
        segments = _guessed_segments(voltage.n)
        doubts.append(Message("learn-segments-guessed", n=voltage.n, segments=len(segments)))
    used = {(message.can_id, signal.name) for message, signal in voltage.members}
    temperatures = [
        each
        for each in _ranked(survey, "temperature")
        if not {(message.can_id, signal.name) for message, signal in each.members} & used
    ]
    temperature = temperatures[0] if temperatures and temperatures[0].score >= _LEAST_SCORE["temperature"] else None
    if temperature is None:
        doubts.append(Message("learn-no-temperatures"))
    else:
        used |= {(message.can_id, signal.name) for message, signal in temperature.members}
        if temperature.fit is not None and temperature.fit.others:  # 2950 is 22 degC in 0.1 K, 29.5 in 0.01 degC
            others = ", ".join(temperature.fit.others)
            doubts.append(Message("learn-temperature-unit-guessed", unit=temperature.fit.unit, others=others))
    sensors = () if temperature is None else _sensors(temperature, segments)
    battery = Battery(name, segments, sensors=sensors)
    cells = {"voltage": voltage.entries} | ({} if temperature is None else {"temperature": temperature.entries})
    cells = {kind: _checked(survey, kind, entries) for kind, entries in cells.items()}
    source = SpeaksDbc(dbc, cells)
    heard = _decoded(survey, battery, source, frames)
    if "voltage" in heard and any(entry.numbers for entry in voltage.entries) and not _came_round(heard["voltage"]):
        doubts.append(Message("learn-round-not-complete", n=battery.n_cells))
    sum_v = _sum_of_cells(heard.get("voltage"), battery.n_cells)
    packs = pack_voltage_proposals(survey, sum_v, used)
    pack = _pack_voltage(survey, packs, heard.get("voltage"), battery.n_cells)
    currents = current_proposals(survey, pack, used)
    socs = soc_proposals(survey, used)
    readings = {
        key: found[0] for key, found in (("current", currents), ("pack_voltage", packs), ("soc", socs)) if found
    }
    if "current" not in readings:
        doubts.append(Message("learn-no-current"))
    elif not readings["current"].is_unit_told:
        doubts.append(Message("learn-current-unit-guessed", name=str(readings["current"].reading.signal)))
    chosen: dict[str, Any] = {key: each.reading for key, each in readings.items()}
    source = replace(source, **chosen)
    also: dict[str, tuple[CellProposal | ReadingProposal, ...]] = {
        "voltage": tuple(voltages[1:4]),
        "temperature": tuple(temperatures[1:4]),
        "current": tuple(currents[1:4]),
        "pack_voltage": tuple(packs[1:4]),
    }
    voltage = voltage.with_reason(*_facts(heard.get("voltage"), battery.n_cells, sum_v))
    return Learned(battery, source, voltage, temperature, readings, also, tuple(doubts))


def _guessed_unit(voltage: CellProposal) -> str:
    """A unit by name and number of bits, where neither the DBC nor a log tells one; "" where one does."""
    signal = voltage.members[0][1]
    if voltage.fit is not None or signal.unit or signal.layout.scale != 1.0:
        return ""
    if "mv" in words(signal.name):
        return "mV"
    return "0.1mV" if signal.layout.length >= 16 else "mV"


def _ranked(survey: Survey, kind: str) -> list[CellProposal]:
    found = [*family_proposals(survey, kind), *frame_number_proposals(survey, kind)]
    return sorted(found, key=lambda each: -each.score)


def _guessed_segments(n: int) -> tuple[int, ...]:
    """Equal segments of a usual size."""
    for size in _USUAL_SEGMENTS:
        if n % size == 0 and n > size:
            return (size,) * (n // size)
    return (n,)


def _sensors(temperature: CellProposal, segments: tuple[int, ...]) -> tuple[tuple[int, ...], ...]:
    n_cells = sum(segments)
    if temperature.n == n_cells:
        return each_cell(n_cells)
    if temperature.n % len(segments) == 0:
        return spread_in_segments(temperature.n, segments)
    return spread(temperature.n, range(n_cells))


def _checked(survey: Survey, kind: str, entries: tuple[CellSignals, ...]) -> tuple[CellSignals, ...]:
    """Entries with the checksum that every one of their frames has."""
    found = []
    for entry in entries:
        message = next((m for m in survey.definitions.messages if m.name == entry.message), None)
        heard = None if message is None else survey.of(message)
        if heard is not None and any(
            "check" in s.name.lower() or "crc" in s.name.lower() for s in heard.message.signals
        ):
            frames = heard.group.frames
            total = (frames.can_id & 0x7FF).astype(np.int64) + frames.length + frames.data.sum(axis=1, dtype=np.int64)
            last = frames.data[:, 7].astype(np.int64)
            if frames.data.shape[1] == 8 and np.mean(((total - last) & 0xFF) == last) > 0.9:
                found.append(replace(entry, checksum="orion"))
                continue
        found.append(entry)
    return tuple(found)


def _decoded(survey: Survey, battery: Battery, source: SpeaksDbc, frames: Frames) -> dict[str, Values]:
    return BatteryDecoder(battery, source, survey.definitions).decode(frames) if len(frames) else {}


def _came_round(voltages: Values) -> bool:
    """Whether cells that frames number began anew: before, there may be more than were heard."""
    return bool(np.any(np.diff(voltages.index) < 0))


def cell_means(voltages: Values, n_cells: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """(n_cells,) mean voltage of each cell, NaN where it was not heard."""
    known = np.isfinite(voltages.value)
    index, value = voltages.index[known], voltages.value[known]
    count = np.bincount(index, minlength=n_cells)
    total = np.bincount(index, weights=value, minlength=n_cells)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _sum_of_cells(voltages: Values | None, n_cells: int) -> float:
    """Sum of all cells, by the mean of those that were heard where nearly all were."""
    if voltages is None:
        return float("nan")
    means = cell_means(voltages, n_cells)
    known = np.isfinite(means)
    return float(np.nanmean(means) * n_cells) if known.mean() > 0.5 else float("nan")


def _pack_voltage(
    survey: Survey, packs: list[ReadingProposal], voltages: Values | None, n_cells: int
) -> PackVoltage | None:
    """The voltage over time: of the cells where they are fast, else of the pack."""
    if packs and packs[0].score > 4:
        name = packs[0].reading.signal
        for message in survey.definitions.messages:
            heard = survey.signal(message, name.signal) if message.name == name.message else None
            if heard is not None and np.std(heard.values) > 0:
                return PackVoltage(heard.t_ns, heard.values)
    if voltages is None:
        return None
    known = np.isfinite(voltages.value)
    means = cell_means(voltages, n_cells)
    return PackVoltage(voltages.t_ns[known], voltages.value[known] - means[voltages.index[known]])


def _facts(voltages: Values | None, n_cells: int, sum_v: float) -> list[Text]:
    if voltages is None:
        return [Message("learn-nothing-heard")]
    heard = np.unique(voltages.index[np.isfinite(voltages.value)])
    found: list[Text] = [Message("learn-cells-heard", heard=len(heard), n=n_cells)]
    times = [voltages.t_ns[voltages.index == cell] for cell in heard[:: max(1, len(heard) // 20)]]
    gaps = [float(np.median(np.diff(t))) / 1e9 for t in times if len(t) > 1]
    if gaps:
        period_s = float(np.median(gaps))
        found.append(Message("learn-period", period=f"{period_s:.3g}", age=f"{PERIODS_BRIDGED * period_s:.3g}"))
    return found
