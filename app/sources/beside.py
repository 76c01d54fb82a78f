"""Further batteries that one service reads: each has links, recordings, alarms and files of its own."""

from dataclasses import dataclass

from app.battery.library import file_name_of
from app.errors import ConfigError
from app.sources.connections import Connections
from app.sources.loaded_battery import load_battery
from app.words import Message

FOLDER = "beside"  # in the data folder, and in the address of their pages


@dataclass(frozen=True, slots=True)
class BesideBattery:
    """A battery beside the first one."""

    slug: str  # in its address, its folder and its MQTT topics
    segments: tuple[int, ...]
    connections: Connections


def beside(first: str, also: str) -> list[BesideBattery]:
    """Return the batteries that `also` names, PROFILE@INTERFACE:CHANNEL or PROFILE with commas, beside the first.

    Raises:
        ConfigError, ProfileError: there is no such battery, its bus is none, or two have the same name.
        ImportFailed, ExtraMissing: a DBC cannot be read.
    """
    found: list[BesideBattery] = []
    taken = {file_name_of(load_battery(first).battery.name)}
    for each in filter(None, map(str.strip, also.split(","))):
        profile, at, bus = each.partition("@")
        if at and not bus:
            raise ConfigError("also", each, Message("can-url"))
        loaded = load_battery(profile)
        slug = file_name_of(loaded.battery.name)
        if loaded.speaks_dbc is None:
            raise ConfigError("also", each, Message("also-speaks-dbc"))
        if slug in taken:
            raise ConfigError("also", each, Message("also-same-name", name=loaded.battery.name))
        taken.add(slug)
        connections = Connections(None, bus or None, profile)
        connections.check(by_operator=True)
        found.append(BesideBattery(slug, loaded.battery.segments, connections))
    return found
