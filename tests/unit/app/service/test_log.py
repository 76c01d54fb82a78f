import logging

from app.service.log import MOST, WINDOW_S, OfOneKind


def line(text, *values, at_s=0.0):
    record = logging.LogRecord("asyncio", logging.ERROR, __file__, 1, text, values, None)
    record.created = 1000.0 + at_s
    return record


def test_many_lines_of_one_kind_become_a_few_and_a_count():
    few = OfOneKind()
    assert sum(few.filter(line("no %s", number)) for number in range(162_000)) == MOST
    later = line("no %s", "room", at_s=WINDOW_S)
    assert few.filter(later)
    assert later.getMessage() == f"no room (and {162_000 - MOST:,} more of this kind before)"


def test_lines_of_other_kinds_are_written():
    few = OfOneKind()
    for number in range(MOST + 1):
        few.filter(line("no %s", number))
    assert few.filter(line("yes %s", 1))


def test_a_clock_that_is_set_back_silences_nothing():
    few = OfOneKind()
    for number in range(MOST + 1):
        few.filter(line("no %s", number))
    assert few.filter(line("no %s", 1, at_s=-100.0))
