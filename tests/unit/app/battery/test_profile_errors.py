import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.battery.fields import TABLES
from app.battery.library import bundled_profiles, load_part
from app.battery.profile import Document, read_document
from app.battery.profile_errors import errors_of

GOOD = {
    "battery.parallel": "2",
    "battery.cell": '"c"',
    "battery.bleed_ohm": "33",
    "battery.drawing.rows": "1",
    "battery.drawing.order": "[2, 1]",
    "battery.temperatures.sensors": "4",
    "battery.limits.cell_voltage_max_v": "4.2",
    "battery.rules.temperature_max_degc": "60",
    "source.period_s": "0.1",
    "source.current.signal": '"i"',
    "source.current.positive": '"charge"',
    "source.soc.signal": '"s"',
    "source.state.fault.signal": '"f"',
    "source.state.fault.equals": "[2]",
}
BAD = {"packs": '["x"]', "sensors": '"many"', "order": "[1, 1]", "rows": "0"}


def text_of(wrong):
    """A profile with a wrong value at some keys, and the line of each key."""
    tables = {"battery": {"name": '"b"', "packs": "[3, 2]"}, "source": {"dbc": '"a.dbc"'}}
    for path, value in GOOD.items():
        table, _, name = path.rpartition(".")
        tables.setdefault(table, {})[name] = value
    lines, at = [], {}
    for table, keys in tables.items():
        lines.append(f"[{table}]")
        for name, value in keys.items():
            path = f"{table}.{name}"
            lines.append(f"{name} = {BAD.get(name, '{}') if path in wrong else value}")
            at[path] = len(lines)
    return "\n".join(lines) + "\n", at


def errors(text):
    return errors_of(read_document(text, "x.toml", lambda _: Document("", {}, {})))


@given(st.sets(st.sampled_from(sorted(GOOD)), max_size=8))
def test_each_wrong_field_is_told_once_with_its_line(wrong):
    text, at = text_of(wrong)
    found, profile = errors(text)
    assert [(error.path, error.line) for error in found] == sorted(
        ((path, at[path]) for path in wrong), key=lambda each: each[1]
    )
    assert profile is not None


def test_wrong_packs_are_not_told_again_by_what_they_shape():
    text, _ = text_of({"battery.packs"})
    found, _ = errors(text + "[battery.rest]\n")
    assert [error.path for error in found] == ["battery.packs", "battery.rest"]


def test_what_is_missing_is_told_with_its_meaning():
    found, _ = errors("[battery]\n[source]\n[[source.voltage]]\nunit = 'V'\n")
    assert {error.path for error in found} == {
        "battery.name", "battery.packs", "source.dbc", "source.voltage[0].signal",
    }  # fmt: skip


@pytest.mark.parametrize(
    "text", ["battery = 3\nsource = [1]\n", "[battery]\nname = 1\n[[source]]\n", "source.voltage = 4"]
)
def test_a_profile_of_which_nothing_is_left_still_ends_with_errors(text):
    found, _ = errors(text)
    assert found


@pytest.mark.parametrize("name", bundled_profiles())
def test_bundled_profiles_have_none(name):
    found, profile = errors_of(load_part(name))
    missing = ["battery.name", "battery.packs"] if name == "ivt-s" else []
    assert [error.path for error in found] == missing
    assert profile is not None


@given(
    st.dictionaries(
        st.sampled_from([t for t in TABLES if t and "[" not in t]),
        st.dictionaries(st.sampled_from(sorted({f.name for t in TABLES.values() for f in t})),
                        st.one_of(st.integers(), st.text(max_size=3), st.lists(st.integers(), max_size=2)), max_size=4),
        max_size=5,
    )
)  # fmt: skip
def test_any_tables_end_with_errors_or_a_profile(tables):
    values = {}
    for path, keys in tables.items():
        at = values
        for name in path.split("."):
            at = at.setdefault(name, {})
            if not isinstance(at, dict):
                break
        else:
            at.update(keys)
    found, profile = errors_of(Document("x.toml", values, {}))
    assert found or profile is not None
    assert len({error.path for error in found}) == len(found)
