"""Scenario files: any document is refused in one line or can be played; what is inside the limits is accepted."""

import json
import math
import tempfile
from collections.abc import Mapping
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_protocol.messages import EventCode
from simulator.errors import InputError, ScenarioError
from simulator.fault_kinds import FAULTS
from simulator.inputs import NumberRange, check_number
from simulator.loads import PATTERNS_C
from simulator.scenario import ACTIONS, LOADS
from simulator.scenario_file import START_LIMITS, load_scenario
from simulator.scenario_player import ScenarioPlayer
from tests.campaign import examples


def toml(value: object) -> str:
    """Return a value as TOML writes it."""
    match value:
        case bool():
            return str(value).lower()
        case float() if not math.isfinite(value):
            return str(value)
        case Mapping():
            return "{" + ", ".join(f"{json.dumps(key)} = {toml(item)}" for key, item in value.items()) + "}"
        case list():
            return "[" + ", ".join(toml(item) for item in value) + "]"
        case str():
            return json.dumps(value)
    return repr(value)


ODD = st.sampled_from(
    [
        -math.inf,
        math.inf,
        math.nan,
        -1,
        -0.0,
        0,
        1,
        2,
        3.7,
        5,
        17,
        50,
        400,
        1e9,
        -400,
        1e-300,
        10**400,
        True,
        "no",
        "",
        [],
    ]
)
NUMBERS = st.one_of(st.floats(0, 1), st.integers(1, 12), st.floats(), ODD)


def table(required: Mapping[str, st.SearchStrategy], **optional: st.SearchStrategy) -> st.SearchStrategy:
    return st.fixed_dictionaries(dict(required), optional=optional)


DOCUMENTS = table(
    {
        "title": st.just("t"),
        "description": st.just("d"),
        "phase": st.lists(
            table(
                {"load": st.sampled_from(sorted(set(LOADS) - {"endurance"}))},
                for_s=NUMBERS,
                until_soc=NUMBERS,
                current_a=NUMBERS,
                power_scale=NUMBERS,
                pattern=st.sampled_from(sorted(PATTERNS_C)) | ODD,
                laps=NUMBERS,
                file=st.just("none.csv") | ODD,
            ),
            min_size=1,
            max_size=2,
        ),
    },
    seed=st.integers(0, 99) | ODD,
    loop=st.booleans() | ODD,
    start=st.fixed_dictionaries(
        {},
        optional={
            **dict.fromkeys(START_LIMITS, NUMBERS),
            "cells": st.dictionaries(st.just("2/3") | st.text(max_size=5), NUMBERS),
        },
    ),
    config=st.dictionaries(st.sampled_from(("v_cell_max", "balance_threshold", "speed")), NUMBERS, max_size=1),
    fault=st.lists(
        table(
            {"name": st.sampled_from(sorted(FAULTS))},
            at_s=NUMBERS,
            pack=NUMBERS,
            cell=NUMBERS,
            value=NUMBERS,
            for_s=NUMBERS,
        ),
        max_size=2,
    ),
    action=st.lists(table({"name": st.sampled_from(ACTIONS)}, at_s=NUMBERS, argument=NUMBERS), max_size=2),
    expect=st.lists(
        table(
            {"event": st.sampled_from(list(EventCode.__members__))},
            pack=NUMBERS,
            cell=NUMBERS,
            value=NUMBERS,
            after_s=NUMBERS,
            before_s=NUMBERS,
        ),
        max_size=2,
    ),
)


def loaded(document: Mapping[str, object]) -> object:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "any.toml"
        path.write_text("".join(f"{key} = {toml(value)}\n" for key, value in document.items()), encoding="utf-8")
        return load_scenario(path)


@given(document=DOCUMENTS)
@settings(max_examples=examples(150))
def test_a_document_is_refused_in_one_line_or_describes_itself(document):
    refusal = "any.toml"
    try:
        assert loaded(document).describe()
    except ScenarioError as error:
        refusal = str(error)
    assert "any.toml" in refusal
    assert "\n" not in refusal


INSIDE = st.fixed_dictionaries(
    {name: st.floats(limits.minimum, limits.maximum) for name, limits in START_LIMITS.items()}
)
PHASES = st.one_of(
    st.builds(lambda amps: {"load": "constant", "current_a": amps}, st.floats(-1000, 1000)),
    st.builds(
        lambda name, scale: {"load": "pattern", "pattern": name, "power_scale": scale},
        st.sampled_from(sorted(PATTERNS_C)),
        st.floats(0.01, 4),
    ),
    st.sampled_from([{"load": name} for name in ("idle", "rest", "charge", "charge-by-hand")]),
)


@given(start=INSIDE, phase=PHASES, seed=st.integers(0, 2**32 - 1))
@settings(max_examples=examples(15), deadline=None)
def test_whatever_lies_within_the_limits_is_played(start, phase, seed):
    document = {"title": "t", "description": "d", "seed": seed, "start": start, "phase": [phase | {"for_s": 30}]}
    player = ScenarioPlayer(loaded(document), step_s=0.5)
    assert (player.simulation.accumulator.capacity_ah > 0).all()
    player.run(60.0)
    assert player.is_over


@given(value=NUMBERS, low=st.floats(-1e3, 1e3), span=st.floats(0, 1e3), is_whole=st.booleans(), is_above=st.booleans())
def test_a_number_is_within_its_limits_or_refused(value, low, span, is_whole, is_above):
    limits = NumberRange(low, low + span, "V", is_whole=is_whole, is_above=is_above)
    refusal, number = "key = ", None
    try:
        number = check_number("key", value, limits)
    except InputError as error:
        refusal = str(error)
    assert refusal.startswith("key = ")
    assert len(refusal) < 200
    if number is not None:
        assert limits.minimum <= number <= limits.maximum
        assert not (is_above and number == limits.minimum)
        assert not is_whole or number.is_integer()
