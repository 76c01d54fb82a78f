"""Profiles: a configuration as a file for people and git, and back without losing a bit."""

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.configuration.configuration_store import ConfigurationStore, NoSavedConfiguration
from app.configuration.saved_configuration import SavedConfiguration, parse_profile, profile_of, profile_text
from app.errors import ConfigError
from firmware_protocol.config_image import canonical, check, default_image, unit_value, with_raw, with_value
from firmware_protocol.memory_map import CONFIG_FIELDS, N_CAN_MESSAGES
from tests.fake_clock import FakeClock

DEFAULT = default_image()


def text_of(image, **changes):
    document = json.loads(profile_text(SavedConfiguration("dry", 3, "why", "ada", "2026-01-01T00:00:00+00:00", image)))
    return json.dumps(document | changes)


@pytest.fixture
def profiles(tmp_path):
    return ConfigurationStore(tmp_path / "profiles", FakeClock())


@given(st.data())
def test_what_the_master_takes_survives_the_file(data):
    image = DEFAULT
    for field in CONFIG_FIELDS:
        if not field.shape and data.draw(st.booleans()):
            image = with_raw(image, field.name, data.draw(st.integers(field.minimum, field.maximum)))
    ids = st.integers(0, 0x7FF) | st.integers(1 << 31, (1 << 31) + 0x1FFFFFFF)
    image = with_raw(image, "can_tx_msg_id", data.draw(st.lists(ids, min_size=8, max_size=8)))
    lengths = data.draw(st.lists(st.integers(0, 8), min_size=N_CAN_MESSAGES, max_size=N_CAN_MESSAGES))
    image = with_raw(image, "can_rx_msg_len", lengths)
    back = parse_profile(profile_text(SavedConfiguration("a", 1, "", "", "", image))).image
    assert back == canonical(image)
    assert check(back) == check(image)


def test_the_file_is_made_for_git():
    one = profile_text(SavedConfiguration("dry", 1, "", "ada", "", DEFAULT)).splitlines()
    other = profile_text(
        SavedConfiguration("dry", 1, "", "ada", "", with_value(DEFAULT, "v_cell_max", 4.15))
    ).splitlines()
    [(before, after)] = [(a, b) for a, b in zip(one, other, strict=True) if a != b]
    assert '"v_cell_max": {"value": 4.2, "unit": "V", "comment": "highest' in before
    assert '"value": 4.15' in after


@given(st.binary(max_size=200) | st.text(max_size=200))
def test_any_text_is_a_profile_or_an_error(text):
    with pytest.raises(ConfigError):
        parse_profile(text)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=9) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=12,
)


@given(st.data())
def test_any_value_anywhere_is_a_profile_or_an_error_that_names_a_field(data):
    document = json.loads(text_of(DEFAULT))
    at = document
    for _ in range(data.draw(st.integers(0, 3))):
        if not isinstance(at, dict | list) or not at:
            break
        key = data.draw(st.sampled_from(sorted(at) if isinstance(at, dict) else range(len(at))))
        if not isinstance(at[key], dict | list):
            break
        at = at[key]
    key = data.draw(st.sampled_from(sorted(at) if isinstance(at, dict) else range(len(at))))
    at[key] = data.draw(JSON)
    assert outcome_of(json.dumps(document)), "an image of 420 bytes, or the name of a field"


def outcome_of(text):
    try:
        return len(parse_profile(text).image) == 420
    except ConfigError as error:
        return error.field and error.limit


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"format": "other"}, "format"),
        ({"format_version": 2}, "format_version"),
        ({"memory_map": "00"}, "memory_map"),
        ({"version": 0}, "version"),
        ({"values": {}}, "values.ts"),
        ({"can_sent": []}, "can_sent"),
        ({"name": 5}, "name"),
    ],
)
def test_what_is_wrong_is_named(change, field):
    with pytest.raises(ConfigError) as caught:
        parse_profile(text_of(DEFAULT, **change))
    assert caught.value.field == field


@pytest.mark.parametrize("value", [10**400, -(10**400), float("nan"), float("inf"), True, "4.2", [4.2], None])
def test_a_value_that_is_no_number_of_the_field_is_named(value):
    document = json.loads(text_of(DEFAULT))
    document["values"]["v_cell_max"]["value"] = value
    with pytest.raises(ConfigError) as caught:
        parse_profile(json.dumps(document))
    assert caught.value.field == "v_cell_max"


def test_a_value_in_another_unit_is_not_taken_for_ours():
    document = json.loads(text_of(DEFAULT))
    document["values"]["v_cell_max"] = {"value": 4200, "unit": "mV"}
    with pytest.raises(ConfigError) as caught:
        parse_profile(json.dumps(document))
    assert (caught.value.field, caught.value.limit) == ("values.v_cell_max.unit", "V")


def test_versions_count_on(profiles):
    hotter = with_raw(DEFAULT, "t_cell_max", 50)
    assert profiles.save("wet", DEFAULT, comment="", who="ada").version == 1
    assert profiles.save("wet", hotter, comment="hot day", who="bob").version == 2
    assert (profiles.names(), profiles.versions("wet")) == (["wet"], [2, 1])
    assert (profiles.load("wet").image, profiles.load("wet", 1).image) == (hotter, DEFAULT)
    profiles.delete("wet")
    assert profiles.names() == []
    with pytest.raises(NoSavedConfiguration):
        profiles.load("wet")
    assert profiles.save("wet", DEFAULT, comment="", who="ada").version == 3


def test_a_file_that_came_by_git_counts_too(profiles, tmp_path):
    (tmp_path / "profiles").mkdir()
    (tmp_path / "profiles" / "dry.json").write_text(text_of(DEFAULT))
    assert profiles.load("dry").saved_by == "ada"
    assert profiles.save("dry", DEFAULT, comment="", who="bob").version == 4


@pytest.mark.parametrize("name", ["", "../x", "A", "a b", "con", "nul.x", ".x", "x" * 41, "a/b", "a\\b", "ä"])
def test_names_that_are_no_files_are_refused(profiles, name):
    with pytest.raises(ConfigError) as caught:
        profiles.save(name, DEFAULT, comment="", who="ada")
    assert caught.value.field == "name"


def test_a_profile_that_cannot_be_read_is_not_called_missing(profiles, tmp_path, monkeypatch):
    profiles.save("wet", default_image(), comment="", who="ada")

    def refuse(*_):
        raise OSError(24, "Too many open files")

    with monkeypatch.context() as patch:
        patch.setattr("pathlib.Path.read_bytes", refuse)
        with pytest.raises(ConfigError, match="Too many open files"):
            profiles.load("wet")
        with pytest.raises(ConfigError, match="Too many open files"):
            profiles.save("wet", default_image(), comment="", who="ada")
    assert profiles.save("wet", default_image(), comment="", who="ada").version == 2


FIRST = (
    Path(__file__).parents[3] / "recorded" / "first_map" / "profile.json"
)  # by the program of the day before the change


def test_a_profile_of_the_first_map_is_converted_and_says_so():
    profile = parse_profile(FIRST.read_bytes())
    values = {name: unit_value(profile.image, name) for name in ("telemetry_period", "ts", "v_cell_max")}
    assert values == {"telemetry_period": 250, "ts": 100, "v_cell_max": 4.2}
    assert check(profile.image) == []
    assert profile.origin == "old-map@1, converted from map 3b6bf984ad19a456"
    again = parse_profile(profile_text(profile))
    assert (again.image, again.origin) == (profile.image, profile.origin)


def test_what_was_converted_stays_marked_until_the_name_is_saved_anew(profiles):
    old = parse_profile(FIRST.read_bytes())
    profiles.save("wet", old.image, comment="", who="ada", converted_from=old.converted_from)
    assert profiles.load("wet").converted_from == "3b6bf984ad19a456"
    profiles.save("wet", old.image, comment="", who="ada")
    assert profiles.load("wet").converted_from is None
    assert profiles.load("wet", 1).converted_from == "3b6bf984ad19a456"


@pytest.mark.parametrize("said", [5, "0123", ["3b6bf984ad19a456"]])
def test_a_map_that_nobody_knows_is_no_source_of_a_conversion(said):
    document = json.loads(text_of(DEFAULT, converted_from=said))
    with pytest.raises(ConfigError) as refused:
        profile_of(document)
    assert refused.value.field == "converted_from"


@pytest.mark.parametrize(
    ("name", "entry", "field"),
    [
        ("ts", {"value": 19, "unit": "ms"}, "telemetry_period"),
        ("ts", {"value": 100, "unit": "sample"}, "values.telemetry_period.unit"),
        ("telemetry_period", {"value": 100, "unit": "ms"}, "values.telemetry_period"),
    ],
)
def test_what_the_first_map_did_not_have_is_refused(name, entry, field):
    document = json.loads(FIRST.read_text())
    document["values"][name] = entry
    with pytest.raises(ConfigError) as refused:
        profile_of(document)
    assert refused.value.field == field


def test_a_present_profile_may_not_mean_milliseconds_by_ts():
    document = json.loads(profile_text(parse_profile(FIRST.read_bytes())))
    document["values"]["ts"] = {"value": 100, "unit": "ms"}
    with pytest.raises(ConfigError) as refused:
        profile_of(document)
    assert refused.value.field == "values.ts.unit"
