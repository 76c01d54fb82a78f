"""A profile draft: inferred from a bus or a log, corrected line by line, checked, with the values that it reads."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from app.battery.profile import Document, read_document
from app.battery.profile_errors import errors_of
from app.battery.source import DbcMapping
from app.battery.table_reader import ProfileError
from app.sources.dbc.battery_decoder import BatteryDecoder, ChannelValues
from app.sources.dbc.check import ProfileIssue, issues_of, oddities_of
from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.definitions import Definitions
from app.sources.dbc.frames import Frames, load_log_of_bus
from app.sources.dbc.infer.bus_survey import BusSurvey, survey_bus
from app.sources.dbc.infer.inference import InferredProfile, infer_profile, taken
from app.sources.dbc.infer.lines import Choice, ProfileLine, find_signal
from app.sources.dbc.infer.profile_text import profile_text
from app.sources.dbc.infer.states import StateProposal
from app.sources.dbc.listening import BusListener
from app.sources.dbc.parts import parts_on
from app.words import Message

PROFILE = "profile.toml"
LEAST_S, MOST_S = 10.0, 120.0  # recording time: sign and periods are seen by then, and the longest round of cells
Run = Callable[..., Any]  # calls a function with arguments that can be pickled, here or in a limited process


@dataclass(frozen=True, slots=True)
class CurrentValue:
    """The present value of a line: the newest of each cell or sensor, or of the one signal."""

    values: tuple[float | None, ...]  # V, degC, A, a fraction of 1; 0 or 1 of a state
    age_s: float | None  # age of the newest value: now on a bus, at the end of a log
    raw: int | None = None  # raw value of a state
    text: str = ""  # text of that raw value


@dataclass(frozen=True, slots=True)
class Correction:
    """A person's correction of a suggestion; empty: as suggested."""

    name: str = ""
    segments: tuple[int, ...] = ()
    parallel: int = 1
    choices: Mapping[str, Choice] = field(default_factory=dict)


def _here(function: Callable[..., Any], *arguments: object) -> Any:
    return function(*arguments)


class ProfileDraft:
    """A profile suggested from the frames at its start; a bus stays open for the current values."""

    def __init__(
        self,
        definitions: Definitions,
        files: tuple[str, ...],
        frames: Frames,
        name: str,
    ) -> None:
        """`files` are the DBCs as the profile names them."""
        self.survey: BusSurvey = survey_bus(definitions, frames)
        self._files = files
        self._frames = frames
        self._name = name
        self.listener: BusListener | None = None  # receives from the bus of the frames
        self.is_recording = False  # frames of the bus are still added
        self._last: tuple[Correction, InferredProfile | None, list[ProfileIssue]] | None = None
        self._checked: tuple[str, list[ProfileIssue]] | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Return the state for another process: all but the open bus."""
        return self.__dict__ | {"listener": None}

    @property
    def recorded_s(self) -> float:
        """Time between the first and the last frame that the suggestion is based on [s]."""
        return self.survey.duration_s

    def extended(self, frames: Frames, correction: Correction) -> "ProfileDraft":
        """Return the draft by more frames of the same bus, inferred; it still records where they are not enough."""
        draft = ProfileDraft(self.survey.definitions, self._files, frames, self._name)
        inferred, _ = draft.inferred(correction)
        is_enough = not draft.survey.received if inferred is None else inferred.is_round_complete
        draft.is_recording = draft.recorded_s < (LEAST_S if is_enough else MOST_S)
        return draft

    def close(self) -> None:
        """Give the bus free."""
        if self.listener is not None:
            self.listener.close()

    def inferred(self, correction: Correction, run: Run = _here) -> tuple[InferredProfile | None, list[ProfileIssue]]:
        """Return the suggestion as corrected, None where no cell voltages are found; and what is doubtful of it."""
        if self._last is None or self._last[0] != correction:
            self._last = correction, *run(ProfileDraft._suggestion, self, correction)
        return self._last[1], self._last[2]

    def check(self, text: str, run: Run = _here) -> list[ProfileIssue]:
        """Return every issue of a profile's text, by the definitions and the received frames."""
        if self._checked is None or self._checked[0] != text:
            self._checked = text, run(ProfileDraft._issues, self, text)
        return self._checked[1]

    def _suggestion(self, correction: Correction) -> tuple[InferredProfile | None, list[ProfileIssue]]:
        inferred = infer_profile(
            self.survey,
            self._frames,
            correction.name or self._name,
            self._files,
            correction.choices,
            correction.segments,
            correction.parallel,
        )
        return inferred, oddities_of(self.survey.definitions) if inferred is None else self._issues(
            profile_text(inferred)
        )

    def _issues(self, text: str) -> list[ProfileIssue]:
        try:
            errors, profile = errors_of(read_document(text, PROFILE, lambda _: Document("", {}, {})))
        except ProfileError as error:
            errors, profile = [error], None
        issues = [ProfileIssue(error.file, error.line, error.path, error.limit, is_error=True) for error in errors]
        if profile is None or errors:
            return issues
        source = profile.source
        if not isinstance(source, DbcMapping):
            return [ProfileIssue(PROFILE, None, "source.kind", Message("check-no-voltages"), is_error=True)]
        frames = self._frames if len(self._frames) else None
        return issues_of(profile.battery, source, self.survey.definitions, PROFILE, frames)

    def running(self, inferred: InferredProfile) -> dict[str, CurrentValue]:
        """Return what each line reads, by its key; a line of which nothing is received is left out."""
        frames = self._frames if self.listener is None else self.listener.frames()
        if not len(frames):
            return {}
        shown = {key: replace(line, is_taken=True) for key, line in inferred.lines.items()}
        battery, source = taken(inferred.battery, inferred.source, shown)
        values = BatteryDecoder(battery, source, self.survey.definitions).decode(frames)
        now_ns = int(frames.t_ns.max()) if self.listener is None else time.monotonic_ns()
        received = survey_bus(self.survey.definitions, frames)
        sizes = {"voltage": battery.n_cells, "temperature": battery.n_sensors}
        current = {}
        for key, line in shown.items():
            if key in values:
                current[key] = _running(values[key], sizes.get(key, 1), now_ns, line, received)
        return current


def _running(values: ChannelValues, size: int, now_ns: int, line: ProfileLine, received: BusSurvey) -> CurrentValue:
    newest = np.full(size, np.nan)
    newest[values.index] = values.value  # the last one of several stays
    age_s = (now_ns - int(values.t_ns.max())) / 1e9
    numbers = tuple(float(value) if np.isfinite(value) else None for value in newest)
    if isinstance(line.chosen, StateProposal):
        named = find_signal(received.definitions, str(line.chosen.state.signal))
        signal = None if named is None else received.signal(named[0], named[1].name)
        if named is not None and signal is not None:
            raw = int(signal.raw[-1])
            return CurrentValue(numbers, age_s, raw, named[1].choices.get(raw, ""))
    return CurrentValue(numbers, age_s)


def draft_from_files(files: Mapping[str, str], received: Frames | Path, name: str, bus: str = "") -> ProfileDraft:
    """Return the draft that files suggest; the messages of a bundled part that are received belong to it.

    Args:
        files: message definitions as text, by file name.
        received: frames of a bus, or a CAN log.
        name: of the profile; the first file's where empty.
        bus: of the log.

    Raises:
        ImportFailed, ExtraMissing: a file cannot be read, or an id is on two buses of the log.
    """
    definitions = Definitions(())
    for file, text in files.items():
        definitions = definitions.joined(parse_definitions(text.encode(), file))
    frames = received if isinstance(received, Frames) else load_log_of_bus(received, definitions, bus)
    definitions, parts = parts_on({int(can_id) for can_id in np.unique(frames.can_id)}, definitions)
    draft = ProfileDraft(definitions, (*files, *parts), frames, name or Path(next(iter(files))).stem)
    draft.inferred(Correction())
    return draft
