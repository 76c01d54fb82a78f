"""A suggestion as TOML: whatever was inferred, the text is a profile that says the same."""

import tomllib
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.battery.battery import Battery, SignalName, each_cell, spread, spread_in_packs
from app.battery.profile import read_document, understand
from app.battery.source import PARTS, CellSignals, DbcMapping, ScalarSignal
from app.sources.dbc.infer.inference import InferredProfile
from app.sources.dbc.infer.lines import ProfileLine
from app.sources.dbc.infer.profile_text import profile_text
from app.sources.dbc.infer.proposal import CellProposal
from app.sources.dbc.infer.readings import ReadingProposal
from app.words import Message

ENTRY = CellSignals("Cell_{cell}", base={"cell": 1})


def inferred(battery=None, entry=ENTRY, readings=None, others=None, questions=(), dbc=("x.dbc",)):
    battery = battery or Battery("Accumulator", (12, 12))
    readings = {name: ReadingProposal(each, (), 3.0) for name, each in (readings or {}).items()}
    others = others or {}
    proposal = CellProposal(
        "voltage", (entry,), battery.n_cells, None, (), (Message("infer-nothing-received"),), 9.0, None
    )
    source = replace(DbcMapping(dbc, {"voltage": (entry,)}), **{name: each.reading for name, each in readings.items()})
    lines = {"voltage": proposal} | readings
    found = {key: ProfileLine(key, (each, *others.get(key, ())), each, True) for key, each in lines.items()}
    return InferredProfile(battery, source, found, tuple(questions))


def read(suggestion):
    return understand(read_document(profile_text(suggestion), "x.toml", lambda name: None))


def plain(entry):
    """An entry without its line; a base that is not named is 0."""
    return replace(entry, line=None, base={part: entry.base.get(part, 0) for part in PARTS})


ENTRIES = st.builds(
    CellSignals,
    signal=st.sampled_from(["Cell_{cell}", "Seg{pack:a}_{cell}", "V{cell}"]),
    message=st.sampled_from(["*", "BMS_Cells", "Module_{pack}_*"]),
    numbers=st.sampled_from([{}, {"cell": "Cell_ID"}, {"pack": "ic", "group": "page"}]),
    base=st.sampled_from([{}, {"cell": 1}, {"pack": 1, "cell": 1}]),
    group_cells=st.integers(1, 6),
    first=st.integers(0, 20),
    unit=st.sampled_from(["", "mV", "0.1mV", "V"]),
    invalid=st.sampled_from([(), (0,), (0, 65535), (-1,), (-32768, 32767)]),
    invalid_signal=st.sampled_from(["", "Bad_{cell}"]),
    checksum=st.sampled_from(["", "orion"]),
)


@given(ENTRIES)
def test_a_way_to_speak_is_read_again_as_it_was_learned(entry):
    if set(entry.numbers) & {"pack"} and "{pack" in entry.signal + entry.message:
        entry = replace(entry, numbers={})
    (found,) = read(inferred(entry=entry)).source.cells["voltage"]
    assert plain(found) == plain(entry)


@pytest.mark.parametrize(
    ("sensors", "segments"),
    [
        ((), (12, 12)),
        (each_cell(24), (12, 12)),
        (spread_in_packs(6, (12, 12)), (12, 12)),
        (spread_in_packs(6, (10, 14)), (10, 14)),
        (spread(5, range(24)), (12, 12)),
        (((0, 1), (), (23,)), (12, 12)),
    ],
)
def test_which_cells_each_sensor_stands_for_is_read_again(sensors, segments):
    battery = read(inferred(Battery("x", segments, sensors=sensors))).battery
    assert (battery.sensors, battery.segments) == (sensors, segments)


@pytest.mark.parametrize("positive", ["discharge", "charge"])
def test_sign_and_unit_of_readings_are_read_again(positive):
    current = ScalarSignal(SignalName("BMS", "I"), "0.1A", positive)
    pack = ScalarSignal(SignalName("BMS", "U"), "")
    source = read(inferred(readings={"current": current, "pack_voltage": pack})).source
    assert replace(source.current, line=None) == current
    assert replace(source.pack_voltage, line=None) == pack


@pytest.mark.parametrize(("language", "said"), [("en", "no current"), ("nb", "strøm")])
def test_doubts_stand_above_all_as_comments_in_the_language_of_the_reader(language, said):
    text = profile_text(inferred(questions=[Message("infer-no-current")]), language)
    head = text[: text.index("[battery]")]
    assert said in head
    assert all(line.startswith("#") for line in head.splitlines() if line)


def test_reasons_stand_above_what_they_speak_for_and_what_else_is_possible_below():
    other = ReadingProposal(ScalarSignal(SignalName("IVT", "Result_I")), (), 2.0)
    cells = CellProposal("voltage", (CellSignals("Zelle{cell}", "Alt"),), 4, None, (), (), 2.0, None)
    current = {"current": ScalarSignal(SignalName("BMS", "Pack_Current"))}
    text = profile_text(inferred(readings=current, others={"current": (other,), "voltage": (cells,)}))
    assert text.index("not received; based on") < text.index("[[source.voltage]]")
    assert "# also possible as current, less likely:\n#   IVT.Result_I" in text
    assert "#   Alt: Zelle{cell}" in text
    assert "possible as temperature" not in text


@pytest.mark.parametrize("odd", ["\n[source.soc]\nsignal = 'A.B'", "\r", "\x00", "\x1b[31m", "\x7f", "\u2028"])
def test_what_a_dbc_says_stays_in_its_comment(odd):
    reading = ScalarSignal(SignalName("BMS", "Pack_Current"))
    suggestion = inferred(readings={"current": reading})
    line = suggestion.lines["current"]
    why = Message("infer-state-texts", name=f"Bms{odd}State", message="BMS", texts=f"3 Drive{odd}")
    lines = {**suggestion.lines, "current": replace(line, chosen=replace(line.chosen, reasons=(why,)))}
    said = replace(suggestion, lines=lines)
    assert tomllib.loads(profile_text(said)) == tomllib.loads(profile_text(suggestion))


@given(st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=20))
def test_any_name_of_a_battery_and_a_file_is_read_back(name):
    text = profile_text(inferred(Battery(name, (12, 12)), dbc=(f"{name}.dbc", "b.dbc")))
    found = tomllib.loads(text)
    assert (found["battery"]["name"], found["source"]["dbc"]) == (name, [f"{name}.dbc", "b.dbc"])
