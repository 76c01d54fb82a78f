"""A draft: corrected line by line, checked, with what each line reads."""

import math
import time
import tomllib

import can
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.battery.profile import read_document, understand
from app.errors import ImportFailed
from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.frames import frames_of
from app.sources.dbc.infer.lines import Choice, title
from app.sources.dbc.infer.profile_draft import Correction, ProfileDraft, draft_from_files
from app.sources.dbc.infer.profile_text import profile_text
from app.sources.dbc.listening import BusListener
from app.sources.loaded_battery import load_battery
from tests.naming_habits import letters_in_numbered_messages, pairs_in_fd_frames

PEER = letters_in_numbered_messages()
DEFINITIONS = parse_definitions(PEER.dbc().encode(), "x.dbc")
FRAMES = PEER.frames(3.0)


@pytest.fixture(scope="module")
def draft():
    return ProfileDraft(DEFINITIONS, ("x.dbc",), frames_of(FRAMES), "x")


def test_each_line_has_what_it_reads_also_those_that_are_not_taken(draft):
    inferred, issues = draft.inferred(Correction())
    running = draft.running(inferred)
    assert issues == []
    assert set(running) == set(inferred.lines)
    assert len(running["voltage"].values) == 160
    assert running["voltage"].values[7] == pytest.approx(PEER.voltage(7, 2.9), abs=0.001)
    assert running["current"].values == (pytest.approx(PEER.current(2.98), abs=0.02),)
    closed = running["state.closed"]
    assert (closed.values, closed.raw, closed.text) == ((1.0,), 2, "TS_ACTIVE")
    assert 0 <= running["voltage"].age_s < 0.2


def test_a_correction_changes_the_suggestion_and_is_checked(draft):
    inferred, issues = draft.inferred(Correction(choices={"current": Choice(is_taken=False)}))
    assert "current" not in inferred.readings
    assert [each.what.code for each in issues] == ["check-no-current"]
    inferred, issues = draft.inferred(Correction("ours", (40,) * 4, 3))
    assert (inferred.battery.name, inferred.battery.segments, inferred.battery.parallel) == ("ours", (40,) * 4, 3)


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("[battery", "TOML"),
        ('[battery]\nname = "x"\npacks = [0]\n[source]\ndbc = "x.dbc"\n', "battery.packs"),
        ('[battery]\nname = "x"\nsegments = [1]\n[source]\nkind = "master"\n', "source.kind"),
    ],
)
def test_errors_of_an_edited_text_are_told_with_their_field(draft, text, field):
    assert [(each.field, each.is_error) for each in draft.check(text)] == [(field, True)]


def test_a_bus_goes_on_to_be_heard():
    with can.Bus("voltwall-lesson", interface="virtual") as bus:
        draft = ProfileDraft(DEFINITIONS, ("x.dbc",), frames_of(FRAMES), "x")
        draft.listener = BusListener("virtual:voltwall-lesson")
        inferred, _ = draft.inferred(Correction())
        assert draft.running(inferred) == {}
        can_id, data = next((i, data) for _, i, data in FRAMES if i == 0x650)
        deadline_s = time.monotonic() + 10
        while not draft.running(inferred) and time.monotonic() < deadline_s:
            bus.send(can.Message(arbitration_id=can_id, is_extended_id=False, data=data))
        assert "current" in draft.running(inferred)
        draft.close()


def test_nobody_asks_and_the_bus_is_given_free():
    with can.Bus("voltwall-idle", interface="virtual"):
        listener = BusListener("virtual:voltwall-idle", idle_s=0.0)
        listener.wait(30)  # ends at once
        listener.close()


def test_the_same_correction_is_learned_once(draft):
    first, _ = draft.inferred(Correction(choices={"soc": Choice(is_taken=False)}))
    assert draft.inferred(Correction(choices={"soc": Choice(is_taken=False)}))[0] is first
    assert draft.inferred(Correction())[0] is not first


@pytest.mark.parametrize(("cells", "field"), [(40, "source.voltage[0].signal"), (200, "source.voltage")])
def test_fewer_or_more_cells_than_the_signals_have_are_told(draft, cells, field):
    _, issues = draft.inferred(Correction(segments=(cells,)))
    assert field in {each.field for each in issues}


def test_the_edited_text_is_checked_by_what_was_heard_and_not_by_what_is_suggested(draft):
    inferred, _ = draft.inferred(Correction())
    text = profile_text(inferred)
    assert draft.check(text) == []
    wrong = draft.check(text.replace("\npacks", "\npack", 1))
    assert wrong
    assert all(each.is_error for each in wrong)


def test_without_frames_nothing_runs_and_a_profile_is_suggested_all_the_same():
    silent = ProfileDraft(DEFINITIONS, ("x.dbc",), frames_of([]), "x")
    inferred, _ = silent.inferred(Correction())
    assert inferred.battery.n_cells == PEER.n_cells
    assert silent.running(inferred) == {}
    silent.close()


def test_a_cell_that_was_not_heard_has_no_value_and_not_zero():
    some = [each for each in FRAMES if each[1] != next(i for _, i, _ in FRAMES)]
    draft = ProfileDraft(DEFINITIONS, ("x.dbc",), frames_of(some), "x")
    running = draft.running(draft.inferred(Correction(segments=(40,) * 4))[0])
    assert all(value is None or value > 2.0 for value in running["voltage"].values)


@settings(max_examples=6, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(sorted({i for _, i, _ in FRAMES})), st.binary(max_size=8)), max_size=60))
def test_whatever_a_bus_says_a_lesson_has_a_suggestion_that_can_be_read_or_none(said):
    draft = ProfileDraft(DEFINITIONS, ("x.dbc",), frames_of([(k * 10**6, i, d) for k, (i, d) in enumerate(said)]), "x")
    inferred, issues = draft.inferred(Correction())
    if inferred is None:
        assert issues == []
        return
    tomllib.loads(profile_text(inferred))
    for key, each in draft.running(inferred).items():
        assert key in inferred.lines
        assert all(value is None or math.isfinite(value) for value in each.values)


PAIRS = pairs_in_fd_frames()
PAIR_FRAMES = PAIRS.frames(2.0)
OTHER = 'VERSION ""\nNS_ :\nBS_:\nBU_: VCU\nBO_ 77 Pedals: 8 VCU\n SG_ Throttle : 0|8@1+ (1,0) [0|100] "%" X\n'


def inferred(draft):
    found, _ = draft.inferred(Correction())
    return found


@pytest.mark.parametrize(("file", "given", "name"), [
    ("ours.dbc", "", "ours"), ("ours.v2.dbc", "", "ours.v2"), ("ours.dbc", "car 26", "car 26")
])  # fmt: skip
def test_the_profile_has_the_name_that_was_given_or_the_first_files(file, given, name):
    draft = draft_from_files({file: PAIRS.dbc(), "pedals.dbc": OTHER}, frames_of([]), given)
    profile = understand(read_document(profile_text(inferred(draft)), "x.toml", lambda _: None))
    assert profile.battery.name == name
    assert profile.source.dbc == (file, "pedals.dbc")


def test_messages_of_all_files_count_whatever_their_order_also_without_frames():
    both = [("pedals.dbc", OTHER), ("ours.dbc", PAIRS.dbc())]
    for files in (both, both[::-1]):
        draft = draft_from_files(dict(files), frames_of([]), "x")
        assert {message.name for message in draft.survey.definitions.messages} >= {"Pedals"}
        assert inferred(draft).battery.n_cells == PAIRS.n_cells


def test_a_log_says_the_same_as_the_bus_that_it_is_of(tmp_path):
    log = tmp_path / "run.log"
    short = [each for each in PAIR_FRAMES if len(each[2]) > 8][:400]
    log.write_text("".join(f"({t / 1e9:.6f}) can0 {i & 0x1FFFFFFF:03X}##1{d.hex().upper()}\n" for t, i, d in short))
    files = {"ours.dbc": PAIRS.dbc()}
    from_bus, from_log = (draft_from_files(files, received, "x") for received in (frames_of(short), log))
    assert profile_text(inferred(from_log)) == profile_text(inferred(from_bus))


def test_definitions_of_something_else_suggest_nothing():
    assert inferred(draft_from_files({"pedals.dbc": OTHER}, frames_of(PAIR_FRAMES), "x")) is None


@pytest.mark.parametrize(("file", "text"), [("bad.dbc", "no such thing"), ("run.log", "time;id;data\n1;2;3\n")])
def test_a_file_that_cannot_be_read_is_named_also_where_others_can(tmp_path, file, text):
    (tmp_path / "run.log").write_text(text)
    files = {"ours.dbc": PAIRS.dbc()} | ({file: text} if file == "bad.dbc" else {})
    with pytest.raises(ImportFailed, match=file.replace(".", r"\.")):
        draft_from_files(files, tmp_path / "run.log" if file == "run.log" else frames_of([]), "x")


def orion_frames(rounds_of_72, seconds_a_cell=0.1, *, first=30):
    """An Orion's broadcast of 72 cells that begins in the middle of a round."""
    battery = load_battery("orion-bms-2")
    message = battery.definitions.messages[0]
    frames = []
    for k in range(round(72 * rounds_of_72)):
        cell = (first + k) % 72
        body = bytes((cell, 0x8F, 0x20 + cell % 7, 0x12, 0x34, 0x8F, 0x10))
        check = (sum(body) + message.can_id + 8) & 0xFF
        frames.append((round(1e9 * seconds_a_cell * k), message.can_id, body + bytes((check,))))
    return battery.definitions, frames_of(frames)


@pytest.mark.parametrize(
    ("rounds", "seconds_a_cell", "goes_on"),
    [(0.4, 0.5, True), (0.5, 0.5, True), (0.9, 0.5, True), (1.05, 0.5, False), (1.5, 0.05, True), (0.9, 2.0, False)],
    ids=[
        "too few to see cells",
        "half a round",
        "wrapped, not all cells",
        "a whole round",
        "a whole round within 10 s",
        "after 2 min",
    ],
)
def test_a_bus_is_recorded_until_every_cell_had_its_turn(rounds, seconds_a_cell, goes_on):
    definitions, frames = orion_frames(rounds, seconds_a_cell)
    empty = ProfileDraft(definitions, ("orion.dbc",), frames_of([]), "x")
    draft = empty.extended(frames, Correction())
    assert draft.is_recording is goes_on
    assert draft.recorded_s == pytest.approx((len(frames) - 1) * seconds_a_cell)


def test_the_messages_of_a_current_sensor_on_the_same_bus_belong_to_the_draft(tmp_path):
    values = [(round(1e7 * k), bytes((0, k % 16, *(1000 + k).to_bytes(4, "big")))) for k in range(300)]
    sensor = [(t_ns, can_id, data) for t_ns, data in values for can_id in (0x521, 0x522, 0x523, 0x524)]
    own = list(FRAMES)
    draft = draft_from_files({"x.dbc": PEER.dbc()}, frames_of(own), "x")
    assert "ivt-s.dbc" not in profile_text(draft.inferred(Correction())[0])
    draft = draft_from_files({"x.dbc": PEER.dbc()}, frames_of(sorted(own + sensor)), "x")
    inferred, _ = draft.inferred(Correction())
    assert "ivt-s.dbc" in profile_text(inferred)
    assert "IVT_Result_I.IVT_Current" in [title(each) for each in inferred.lines["current"].candidates]
