import pytest

from app.errors import ImportFailed
from app.sources.recordings.bad_rows import SHOWN, BadRows
from app.words import render


def bad_rows(count: int) -> BadRows:
    bad = BadRows()
    for number in range(1, count + 1):
        bad.add(number, "no time")
    return bad


def said(bad: BadRows, good: int, language: str = "en") -> str:
    (note,) = bad.notes(good)
    return render(note, language=language)


def test_nothing_is_said_where_everything_was_read() -> None:
    assert bad_rows(0).notes(100) == []


@pytest.mark.parametrize(("count", "warns"), [(5, False), (6, True)])
def test_more_than_one_in_twenty_is_a_warning(count: int, warns: bool) -> None:
    note = said(bad_rows(count), 100 - count)
    assert note.startswith("warning: ") == warns
    assert f"{count} of 100 frames" in note
    assert "line 1: no time; line 2: no time" in note


def test_the_first_ten_are_named() -> None:
    note = said(bad_rows(SHOWN + 5), 1000)
    assert note.count("line ") == SHOWN
    assert note.endswith("...")


def test_what_cannot_be_read_is_said_in_norwegian_too() -> None:
    assert said(bad_rows(2), 1000, "nb") == (
        "2 av 1002 rammer kan ikke leses og er utelatt: linje 1: no time; linje 2: no time"
    )
    assert said(bad_rows(6), 94, "nb").startswith("advarsel: 6 av 100 rammer")


def test_more_than_half_is_a_refusal() -> None:
    bad_rows(50).check("a.log", 50)
    with pytest.raises(ImportFailed, match=r"a\.log: 51 of 100 frames cannot be read, more than half; line 1: no time"):
        bad_rows(51).check("a.log", 49)
