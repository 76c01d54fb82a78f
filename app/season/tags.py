"""Tags of a session: kept in its own file, so that they travel with it."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from app.errors import ConfigError
from app.sessions.info import SessionInfo
from app.sessions.reading.session_info import write_note

NAMES: Final = ("track", "driver", "tyres", "weather", "text")
KEY: Final = "tags"
LONGEST: Final = 200  # characters


def write_tags(path: Path, tags: Mapping[str, str], *, t_wall_ns: int, who: str | None) -> dict[str, str]:
    """Set all tags of a session; what is empty is taken away. Return what was kept.

    Raises:
        ConfigError: a tag of another name, or one that is too long.
        SessionError: the file is no session, or cannot be written.
    """
    kept: dict[str, str] = {}
    for name, value in tags.items():
        if name not in NAMES:
            raise ConfigError("tags", name, ", ".join(NAMES))
        text = " ".join(value.split())
        if len(text) > LONGEST:
            raise ConfigError(name, f"{text[:20]}…", f"at most {LONGEST} characters")
        if text:
            kept[name] = text
    write_note(path, KEY, kept or None, t_wall_ns=t_wall_ns, who=who)
    return kept


def tags_of(info: SessionInfo) -> dict[str, str]:
    """Return the tags of a session; event, driver, vehicle and venue of its start stand in by default."""
    given = info.metadata.get(KEY)
    tags = {name: str(value) for name, value in given.items() if name in NAMES} if isinstance(given, Mapping) else {}
    for name, source in (("driver", "driver"), ("track", "venue")):
        if name not in tags and info.metadata.get(source):
            tags[name] = str(info.metadata[source])
    return tags


def matches(info: SessionInfo, wanted: str) -> bool:
    """Return whether name, id, car or tags of a session hold all words; `since:` and `before:` take a day (UTC)."""
    day = datetime.fromtimestamp(info.started_wall_ns / 1e9, UTC).strftime("%Y%m%d")
    text = " ".join([info.name, info.id, *tags_of(info).values(), *map(str, info.metadata.values())]).casefold()
    for word in wanted.casefold().split():
        name, _, value = word.partition(":")
        if name in ("since", "before"):
            limit = value.replace("-", "")
            if (day < limit) if name == "since" else (day >= limit):
                return False
        elif name == "car" and value:
            if value not in str(info.metadata.get("car", "")).casefold():
                return False
        elif name in NAMES and value:
            if value not in tags_of(info).get(name, "").casefold():
                return False
        elif word not in text:
            return False
    return True
