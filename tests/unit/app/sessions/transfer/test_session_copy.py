"""What an interrupted copy leaves beside the sessions goes, what is being written stays."""

import os

from app.sessions.transfer.session_copy import remove_left_halves

NOW_S = 1_790_000_000.0


def half(folder, name, changed_s):
    place = folder / name
    place.mkdir()
    (place / "s.sqlite").write_bytes(b"half")
    for path in (place / "s.sqlite", place):
        os.utime(path, (changed_s, changed_s))
    return place


def test_only_a_half_that_nobody_writes_any_more_is_removed(tmp_path):
    left = half(tmp_path, ".copying-left", NOW_S - 3600)
    written = half(tmp_path, ".copying-written", NOW_S - 3600)
    os.utime(written / "s.sqlite", (NOW_S - 1, NOW_S - 1))
    session = half(tmp_path, "other", NOW_S - 3600)
    remove_left_halves(tmp_path, NOW_S)
    assert [each.exists() for each in (left, written, session)] == [False, True, True]


def test_a_folder_that_is_not_there_has_none(tmp_path):
    remove_left_halves(tmp_path / "none", NOW_S)
