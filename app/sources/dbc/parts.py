"""Bundled parts of a battery, such as a current sensor: messages that a bus may carry next to those of a BMS."""

from collections.abc import Mapping
from functools import cache, reduce

from app.battery.library import bundled_profiles, profile_files
from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.definitions import Definitions

_LEAST_SHARE = 0.5  # share of the messages that shows a part


@cache
def bundled_parts() -> Mapping[str, Definitions]:
    """Return the messages of each bundled part by its name, which `include` takes."""
    return {
        name: reduce(Definitions.joined, map(parse_definitions, files.values(), files), Definitions(()))
        for name, files in _files().items()
    }


def parts_on(ids: set[int], own: Definitions) -> tuple[Definitions, tuple[str, ...]]:
    """Return definitions with those of the parts among received ids, and the files of these; `own` come first."""
    more: tuple[str, ...] = ()
    for name, definitions in bundled_parts().items():
        if is_present(definitions, ids) and not own.by_id().keys() & definitions.by_id().keys():
            own, more = own.joined(definitions), (*more, *_files()[name])
    return own, more


@cache
def _files() -> Mapping[str, dict[str, bytes]]:
    """The DBCs of each part: of a bundled profile that describes no battery."""
    parts = {}
    for name in bundled_profiles():
        files = profile_files(name)
        if not any(b"\n[battery]" in data for data in files.values()):
            parts[name] = {file: data for file, data in files.items() if not file.endswith(".toml")}
    return parts


def is_present(definitions: Definitions, ids: set[int]) -> bool:
    """Return whether most messages of a battery or part are among ids that were received."""
    own = definitions.by_id().keys()
    n = len(ids & own)
    return n > 0 and n >= _LEAST_SHARE * len(own)
