"""A command is in the event log with who sent it and what became of it."""

import errno
from dataclasses import dataclass, field

import pytest

from app.configuration.history import BEGUN, ConfigHistory, JsonLines
from app.configuration.write_log import WriteLog
from app.errors import LinkLost, MasterRefused
from app.service.master import MasterCommands
from app.sessions.errors import RecordingFailed
from firmware_protocol.messages import Command, CommandId
from tests.fake_clock import FakeClock

RESET = Command(CommandId.RESET)


@dataclass
class FakeLinks:
    """The master, its stream, and the error that it answers with."""

    error: Exception | None = None
    requests: list[object] = field(default_factory=list)

    @property
    def master(self):
        return self

    def request(self, request):
        self.requests.append(request)
        if self.error is not None:
            raise self.error

    def stream(self, *, on):
        self.request("x" if on else "y")


@dataclass
class FakeEvents:
    noted: list[tuple] = field(default_factory=list)

    def note(self, severity, code, text, who=None):
        self.noted.append((severity, code, str(text), who))


@pytest.fixture
def links():
    return FakeLinks()


@pytest.fixture
def events():
    return FakeEvents()


@pytest.fixture
def history(tmp_path):
    return ConfigHistory(tmp_path)


@pytest.fixture
def signed(history, events):
    return WriteLog(history, events.note, FakeClock())


def full_disk(*args, **kwargs):
    raise OSError(errno.ENOSPC, "No space left on device")


def test_a_command_is_sent_and_noted(links, events, signed):
    MasterCommands(links, events, signed).send("fan-override", RESET, "anna", "0.5 for 60 s")
    assert links.requests == [RESET]
    ((severity, code, text, who),) = events.noted
    assert (severity, code, who) == ("info", "command", "anna")
    assert "fan-override 0.5 for 60 s" in text


def test_a_refused_command_is_a_warning_and_an_error(links, events, signed):
    links.error = MasterRefused("COMMAND", "NOT_NOW", None)
    with pytest.raises(MasterRefused):
        MasterCommands(links, events, signed).send("reset", RESET, "anna")
    ((severity, code, text, _),) = events.noted
    assert (severity, code) == ("warning", "command-failed")
    assert "refused-not-now" in text


@pytest.mark.parametrize(("on", "byte", "name"), [(True, "x", "stream-start"), (False, "y", "stream-stop")])
def test_the_stream_is_started_and_stopped(links, events, signed, on, byte, name):
    MasterCommands(links, events, signed).stream("anna", on=on)
    assert links.requests == [byte]
    assert name in events.noted[0][2]


def test_a_stream_without_a_link_is_not_noted(links, events, signed):
    links.error = LinkLost("no RS232 port is configured")
    with pytest.raises(LinkLost):
        MasterCommands(links, events, signed).stream("anna", on=True)
    assert events.noted == []


def test_the_signed_log_has_the_command_before_the_master_and_its_outcome_after(links, events, signed, history):
    links.request = lambda request: links.requests.append([record.result for record in history.records()])
    MasterCommands(links, events, signed).send("fan-override", RESET, "anna", "0.5")
    assert links.requests == [[BEGUN]]
    (record,) = history.records()
    assert (record.who, record.action, record.source, record.result) == ("anna", "command", "fan-override 0.5", "done")
    assert record.is_genuine


def test_a_refused_command_is_in_the_signed_log_as_refused(links, events, signed, history):
    links.error = MasterRefused("COMMAND", "NOT_NOW", None)
    with pytest.raises(MasterRefused):
        MasterCommands(links, events, signed).send("reset", RESET, "anna")
    (record,) = history.records()
    assert "not possible while driving" in record.result


def test_on_a_full_disk_nothing_begins_and_everything_can_be_ended(links, events, signed, monkeypatch):
    monkeypatch.setattr(JsonLines, "append", full_disk)
    commands = MasterCommands(links, events, signed)
    with pytest.raises(RecordingFailed, match="No space left"):
        commands.send("charge-start", RESET, "anna")
    assert links.requests == []
    commands.send("charge-stop", RESET, "anna")
    assert links.requests == [RESET]
    assert "config-history-failed" in [code for _, code, _, _ in events.noted]
