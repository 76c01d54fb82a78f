"""`voltwall battery list` and `show`: bundled profiles, and what one means."""

import argparse
import json

from app.battery.battery import Battery
from app.battery.drawing import drawn, sensors_in_words
from app.battery.library import bundled_profiles, load_part, load_profile
from app.battery.source import CellSignals, SpeaksDbc, SpeaksMaster
from app.battery.table_reader import ProfileError
from app.commands.console.terminal import print_table


def list_profiles(args: argparse.Namespace) -> int:
    """Print the profiles that come along."""
    found: list[dict[str, object]] = []
    for name in bundled_profiles():
        try:
            battery = load_profile(name).profile.battery
        except ProfileError:
            load_part(name)
            found.append({"profile": name, "name": None})
            continue
        numbers = {"segments": battery.n_segments, "cells": battery.n_cells, "sensors": battery.n_sensors}
        found.append({"profile": name, "name": battery.name, **numbers})
    if args.json:
        print(json.dumps(found, indent=2))
        return 0
    rows = []
    for each in found:
        text = "a part, to include in a profile"
        if each["name"] is not None:
            text = f"{each['name']}: {each['segments']} segments, {each['sensors']} temperature sensors"
        rows.append((str(each["profile"]), text))
    print_table((), rows)
    return 0


def show_profile(args: argparse.Namespace) -> int:
    """Print what one means."""
    loaded = load_profile(args.profile)
    if args.toml:
        print(loaded.text, end="")
        return 0
    battery, source = loaded.profile.battery, loaded.profile.source
    _show_battery(battery)
    if isinstance(source, SpeaksMaster):
        print("source: the team's own master, over RS232 and CAN")
    elif isinstance(source, SpeaksDbc):
        _show_source(source)
    return 0


def _show_battery(battery: Battery) -> None:
    print(f"{battery.name}: {battery.n_cells} cells in {battery.n_segments} segments, {battery.parallel} in parallel")
    print(f"cell: {battery.cell}")
    print("segments on the map, with their cells:")
    print("\n".join(drawn(battery)))
    print(f"temperature sensors: {sensors_in_words(battery)}")
    for title, values in (("limits", battery.limits), ("rules", battery.rules)):
        if values:
            print(f"{title}: " + ", ".join(f"{name} = {value}" for name, value in values.items()))


def _show_source(source: SpeaksDbc) -> None:
    print(f"source: CAN by {', '.join(source.dbc)}")
    for kind, entries in source.cells.items():
        for entry in entries:
            print(f"  {kind}: {_in_words(entry)}")
    for name in ("current", "pack_voltage", "soc", "charger_voltage", "charger_current"):
        reading = getattr(source, name)
        if reading is not None:
            sign = f", positive on {reading.positive}" if "current" in name else ""
            print(f"  {name}: {reading.signal}{sign}")
    for name, state in source.states.items():
        wanted = f"one of the bits {state.mask:#x}" if state.mask else f"{' or '.join(map(str, state.equals))}"
        print(f"  {name}: where {state.signal} is {wanted}")


def _in_words(entry: CellSignals) -> str:
    parts = [f"signals {entry.signal}" + ("" if entry.message == "*" else f" of messages {entry.message}")]
    parts += [f"{part} by signal {signal} of the frame" for part, signal in entry.numbers.items()]
    bases = {part: low for part, low in entry.base.items() if low}
    if bases:
        parts.append("counted from " + ", ".join(f"{low} ({part})" for part, low in bases.items()))
    if entry.group_cells > 1:
        parts.append(f"{entry.group_cells} a group")
    if entry.checksum:
        parts.append(f"checksum {entry.checksum}")
    parts.append(
        "older than three periods is missing"
        if entry.max_age_s is None
        else f"older than {entry.max_age_s:g} s is missing"
    )
    return "; ".join(parts)
