import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from app.errors import ImportFailed
from app.sources.recordings.import_mapping import (
    ImportMapping,
    ImportMappingStore,
    mapping_of,
    mapping_text,
    parse_cells,
    parse_mapping,
)
from tests.campaign import examples

ORION = ImportMapping(
    time="Time", current="Pack Current (A)", voltages="Cell {n} (mV)", voltage_unit="mV",
    temperatures="Thermistor {n} (°C)", soc="Pack SOC (%)",
)  # fmt: skip


@pytest.mark.parametrize(("given", "missing"), [({"voltages": "V{n}"}, "current"), ({"current": "I"}, "voltages")])
def test_a_profile_that_names_too_little_says_what_is_missing(given: dict[str, str], missing: str) -> None:
    with pytest.raises(ImportFailed, match=f"^run.csv: {missing} is not named.*'Speed'"):
        ImportMapping(**given).check_complete("run.csv", ["Speed"])


def test_profiles_are_kept_by_name(tmp_path):
    store = ImportMappingStore(tmp_path / "profiles")
    assert store.names() == []
    store.save("orion", ORION)
    assert store.names() == ["orion"]
    assert store.load("orion") == ORION == parse_mapping(mapping_text(ORION))
    for name in ("../up", "", "a/b"):
        with pytest.raises(ImportFailed, match="cannot be called"):
            store.save(name, ORION)
    with pytest.raises(ImportFailed, match="unknown; available: orion"):
        store.load("other")
    (tmp_path / "profiles" / "bad.toml").write_text("speed = 3")
    with pytest.raises(ImportFailed, match=r"bad\.toml: speed: no such field"):
        store.load("bad")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("current = 3", "current = 3: a str"),
        ("wheels = 4", "wheels: no such field"),
        ("voltage_unit = 'kV'", "one of V, mV"),
        *(
            (f"cells = '{cells}'", f"cells = '{cells}': numbers from 1")
            for cells in ("5-3", "1,,2", "0", "1-", "-3", "1-2-3", "a", "1;2", "12345", "٣", "1.5")
        ),
        ("hold_s = -1", r"hold_s = -1: 0\.\.600"),
        ("[", "invalid TOML"),
    ],
)
def test_a_profile_that_is_wrong_names_the_field(text, reason):
    with pytest.raises(ImportFailed, match=reason):
        parse_mapping(text)


@pytest.mark.parametrize(
    ("field", "limits", "beyond"),
    [
        ("max_rate_hz", (0, 5, 1000.0), (-0.1, 1000.1, float("nan"), float("inf"), True, "5", None, [5.0])),
        ("hold_s", (0, 600.0), (-0.1, 600.1, float("nan"), float("inf"))),
        ("cells_in_series", (1, 2, 1000.0), (0, 0.99, 1000.5, float("nan"))),
    ],
)
def test_a_number_is_within_its_limits_and_no_other_kind_and_else_its_field_is_named(
    field: str, limits: tuple[float, ...], beyond: tuple[object, ...]
) -> None:
    assert [getattr(mapping_of({field: value}), field) for value in limits] == list(limits)
    for value in beyond:
        with pytest.raises(ImportFailed, match=f"{field} = "):
            mapping_of({field: value})


@pytest.mark.parametrize(
    ("text", "spans"),
    [
        ("", []),
        ("  ", []),
        ("7", [(7, 7)]),
        ("1-12,14", [(1, 12), (14, 14)]),
        (" 1 - 12 , 14 ", [(1, 12), (14, 14)]),
        ("14,1-2", [(14, 14), (1, 2)]),  # in the order that they are to be taken in
    ],
)
def test_cells_are_named_by_numbers_and_spans(text: str, spans: list[tuple[int, int]]) -> None:
    assert parse_cells(text) == spans
    assert ImportMapping(cells=text).cells == text


@settings(max_examples=examples(40))
@example('I "hall" \\ Ω\t[A]')
@given(st.text(st.characters(exclude_categories=["Cs"]), max_size=12))
def test_any_name_of_a_column_is_read_back(name: str) -> None:
    profile = ImportMapping(current=name)
    assert parse_mapping(mapping_text(profile)) == profile
