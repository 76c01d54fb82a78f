import pytest

from app.errors import ImportFailed
from app.sources.recordings.bad_rows import SHOWN, BadRows


def bad_rows(count: int) -> BadRows:
    bad = BadRows()
    for number in range(1, count + 1):
        bad.add(number, "no time")
    return bad


def test_nothing_is_said_where_everything_was_read() -> None:
    assert bad_rows(0).notes(100) == []


@pytest.mark.parametrize(("count", "warns"), [(5, False), (6, True)])
def test_more_than_one_in_twenty_is_a_warning(count: int, warns: bool) -> None:
    (note,) = bad_rows(count).notes(100 - count)
    assert note.startswith("warning: ") == warns
    assert f"{count} of 100 frames" in note
    assert "line 1: no time; line 2: no time" in note


def test_the_first_ten_are_named() -> None:
    (note,) = bad_rows(SHOWN + 5).notes(1000)
    assert note.count("line ") == SHOWN
    assert note.endswith("...")


def test_more_than_half_is_a_refusal() -> None:
    bad_rows(50).check("a.log", 50)
    with pytest.raises(ImportFailed, match=r"a\.log: 51 of 100 frames cannot be read, more than half; line 1: no time"):
        bad_rows(51).check("a.log", 49)
