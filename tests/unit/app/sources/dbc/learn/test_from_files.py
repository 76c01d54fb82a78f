"""A lesson of files as they were uploaded: which definitions count, what the profile is called, what is refused."""

import pytest

from app.battery.profile import read_document, understand
from app.errors import ImportFailed
from app.sources.dbc.frames import frames_of
from app.sources.dbc.learn.lesson import Correction, lesson_from_files
from app.sources.dbc.learn.profile_text import profile_text
from tests.naming_habits import pairs_in_fd_frames

PEER = pairs_in_fd_frames()
FRAMES = PEER.frames(2.0)
OTHER = 'VERSION ""\nNS_ :\nBS_:\nBU_: VCU\nBO_ 77 Pedals: 8 VCU\n SG_ Throttle : 0|8@1+ (1,0) [0|100] "%" X\n'


def learned(lesson):
    found, _ = lesson.learned(Correction())
    return found


@pytest.mark.parametrize(("file", "given", "name"), [
    ("ours.dbc", "", "ours"), ("ours.v2.dbc", "", "ours.v2"), ("ours.dbc", "car 26", "car 26")
])  # fmt: skip
def test_the_profile_has_the_name_that_was_given_or_the_first_files(file, given, name):
    lesson = lesson_from_files({file: PEER.dbc(), "pedals.dbc": OTHER}, frames_of(FRAMES), given)
    profile = understand(read_document(profile_text(learned(lesson)), "x.toml", lambda _: None))
    assert profile.battery.name == name
    assert profile.source.dbc == (file, "pedals.dbc")


def test_messages_of_all_files_count_whatever_their_order():
    both = [("pedals.dbc", OTHER), ("ours.dbc", PEER.dbc())]
    for files in (both, both[::-1]):
        lesson = lesson_from_files(dict(files), frames_of(FRAMES), "x")
        assert {message.name for message in lesson.survey.definitions.messages} >= {"Pedals"}
        assert learned(lesson).battery.n_cells == PEER.n_cells


def test_a_log_says_the_same_as_the_bus_that_it_is_of(tmp_path):
    log = tmp_path / "run.log"
    short = [each for each in FRAMES if len(each[2]) > 8][:400]
    log.write_text("".join(f"({t / 1e9:.6f}) can0 {i & 0x1FFFFFFF:03X}##1{d.hex().upper()}\n" for t, i, d in short))
    files = {"ours.dbc": PEER.dbc()}
    from_bus, from_log = (lesson_from_files(files, heard, "x") for heard in (frames_of(short), log))
    assert profile_text(learned(from_log)) == profile_text(learned(from_bus))


def test_without_frames_only_the_names_speak():
    found = learned(lesson_from_files({"ours.dbc": PEER.dbc()}, frames_of([]), "x"))
    assert found.battery.n_cells == PEER.n_cells


def test_definitions_of_something_else_suggest_nothing():
    assert learned(lesson_from_files({"pedals.dbc": OTHER}, frames_of(FRAMES), "x")) is None


def test_a_file_that_cannot_be_read_is_named_also_where_others_can():
    with pytest.raises(ImportFailed, match=r"bad\.dbc"):
        lesson_from_files({"ours.dbc": PEER.dbc(), "bad.dbc": "no such thing"}, frames_of([]), "x")


def test_a_log_that_cannot_be_read_is_named(tmp_path):
    log = tmp_path / "run.log"
    log.write_text("time;id;data\n1;2;3\n")
    with pytest.raises(ImportFailed, match=r"run\.log"):
        lesson_from_files({"ours.dbc": PEER.dbc()}, log, "x")
