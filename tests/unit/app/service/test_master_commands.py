"""A command is in the event log with who sent it and what became of it."""

from dataclasses import dataclass, field

import pytest

from app.errors import LinkLost, MasterRefused
from app.service.master_commands import MasterCommands
from firmware_protocol.messages import Command, CommandId

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


def test_a_command_is_sent_and_noted(links, events):
    MasterCommands(links, events).send("fan-override", RESET, "anna", "0.5 for 60 s")
    assert links.requests == [RESET]
    ((severity, code, text, who),) = events.noted
    assert (severity, code, who) == ("info", "command", "anna")
    assert "fan-override 0.5 for 60 s" in text


def test_a_refused_command_is_a_warning_and_an_error(links, events):
    links.error = MasterRefused("COMMAND", "NOT_NOW", None)
    with pytest.raises(MasterRefused):
        MasterCommands(links, events).send("reset", RESET, "anna")
    ((severity, code, text, _),) = events.noted
    assert (severity, code) == ("warning", "command-failed")
    assert "NOT_NOW" in text


@pytest.mark.parametrize(("on", "byte", "name"), [(True, "x", "stream-start"), (False, "y", "stream-stop")])
def test_the_stream_is_started_and_stopped(links, events, on, byte, name):
    MasterCommands(links, events).stream("anna", on=on)
    assert links.requests == [byte]
    assert name in events.noted[0][2]


def test_a_stream_without_a_link_is_not_noted(links, events):
    links.error = LinkLost("no RS232 port is configured")
    with pytest.raises(LinkLost):
        MasterCommands(links, events).stream("anna", on=True)
    assert events.noted == []
