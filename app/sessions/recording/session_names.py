"""Names and metadata of the next sessions: event, driver, vehicle, venue."""

import json
import logging
import re
from contextlib import suppress
from dataclasses import asdict, dataclass, fields, replace
from datetime import UTC, datetime
from pathlib import Path

from app.errors import ConfigError
from app.sources.data_file import parse_object, replace_file, set_aside
from app.words import Message

log = logging.getLogger(__name__)

CLOCK_IS_SET_NS = 1_704_067_200 * 10**9  # 2024-01-01: a wall clock before it was never set
MAX_CHARACTERS = 60
_PART = re.compile(r"(?P<name>.*), part (?P<number>\d+)$")


@dataclass(frozen=True, slots=True)
class RecordingPlan:
    """Goes into every session that begins, and from there into the exports that have a place for it."""

    event: str = ""
    driver: str = ""
    vehicle: str = ""
    venue: str = ""

    def metadata(self) -> dict[str, object]:
        """Return the metadata by name."""
        return {name: value for name, value in asdict(self).items() if value}

    def name(self, started_wall_ns: int) -> str:
        """Return a session's name by event and local time, with its zone; a clock that was never set gives no time."""
        when = "before the clock was set"
        if started_wall_ns >= CLOCK_IS_SET_NS:
            when = datetime.fromtimestamp(started_wall_ns / 1e9, UTC).astimezone().strftime("%Y-%m-%d %H:%M %Z")
        return f"{self.event} {when}".strip()


def next_part(name: str) -> str:
    """Return the name of the session that goes on where the one of this name ends."""
    match = _PART.fullmatch(name)
    return f"{match['name']}, part {int(match['number']) + 1}" if match else f"{name}, part 2"


def load_plan(path: Path, event: str | None = None) -> RecordingPlan:
    """Return what was kept, nothing where there is nothing; `event` given at the start of the service wins.

    What is no plan is set aside.
    """
    plan = RecordingPlan()
    try:
        kept = parse_object(path.read_bytes())
        names = {field.name for field in fields(RecordingPlan)}
        plan = checked(RecordingPlan(**{name: str(value) for name, value in kept.items() if name in names}))
    except FileNotFoundError:
        pass
    except OSError as error:
        log.warning("%s cannot be read and is ignored: %s", path, error)
    except (ValueError, ConfigError):
        with suppress(OSError):
            set_aside(path)
    return plan if event is None else checked(replace(plan, event=event))


def save_plan(path: Path, plan: RecordingPlan) -> None:
    """Keep it over restarts.

    Raises:
        OSError: the disk does not take it.
    """
    replace_file(path, (json.dumps(asdict(plan), indent=2) + "\n").encode())


def checked(plan: RecordingPlan) -> RecordingPlan:
    """Return it.

    Raises:
        ConfigError: a text is too long.
    """
    for name, text in asdict(plan).items():
        if len(text) > MAX_CHARACTERS:
            raise ConfigError(name, text[:20] + "...", Message("characters-at-most", count=MAX_CHARACTERS))
    return plan
