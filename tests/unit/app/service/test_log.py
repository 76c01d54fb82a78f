import io
import logging
import threading

from app.service.log import MOST, WINDOW_S, QueuedLines, RepeatFilter
from tests.service_process import WAIT_S, until


def line(text, *values, at_s=0.0):
    record = logging.LogRecord("asyncio", logging.ERROR, __file__, 1, text, values, None)
    record.created = 1000.0 + at_s
    return record


def test_many_lines_of_one_kind_become_a_few_and_a_count():
    few = RepeatFilter()
    assert sum(few.filter(line("no %s", number)) for number in range(162_000)) == MOST
    later = line("no %s", "room", at_s=WINDOW_S)
    assert few.filter(later)
    assert later.getMessage() == f"no room (and {162_000 - MOST:,} more of this kind before)"


def test_a_driver_that_repeats_itself_is_written_once_an_hour():
    def said(at_s):
        record = line("%s was not properly shut down", "slcanBus", at_s=at_s)
        record.name = "can.bus"
        return few.filter(record), record.getMessage()

    few = RepeatFilter()
    assert [said(at_s)[0] for at_s in range(0, 3600, 2)].count(True) == 1
    assert said(3600.0) == (True, "slcanBus was not properly shut down (and 1,799 more of this kind before)")


def test_lines_of_other_kinds_are_written():
    few = RepeatFilter()
    for number in range(MOST + 1):
        few.filter(line("no %s", number))
    assert few.filter(line("yes %s", 1))


def test_a_clock_that_is_set_back_silences_nothing():
    few = RepeatFilter()
    for number in range(MOST + 1):
        few.filter(line("no %s", number))
    assert few.filter(line("no %s", 1, at_s=-100.0))


class HeldTerminal(io.StringIO):
    """Takes nothing until it is let go, as one on which somebody pressed Ctrl+S."""

    def __init__(self):
        super().__init__()
        self.go_on = threading.Event()

    def write(self, text):
        assert self.go_on.wait(WAIT_S)
        return super().write(text)


def test_a_terminal_that_is_held_holds_nobody_who_logs():
    terminal = HeldTerminal()
    handler = QueuedLines(terminal)
    for number in range(3000):
        handler.handle(line("no %s", number))
    terminal.go_on.set()
    until(lambda: "no 999\n" in terminal.getvalue())
    handler.handle(line("at last"))
    handler.end()
    lines = terminal.getvalue().splitlines()
    assert [each.split()[1] for each in lines[:1000]] == [str(number) for number in range(1000)]
    assert "lines were left out" in terminal.getvalue()
    assert len(lines) < 1100


class FullDisk(io.StringIO):
    def write(self, text):
        raise OSError(28, "No space left on device")


def test_a_full_disk_costs_only_the_lines(capsys):
    disk = FullDisk()
    handler = QueuedLines(disk)
    handler.handle(line("one"))
    handler.handle(line("two"))
    handler.end()
    assert capsys.readouterr().err == ""
