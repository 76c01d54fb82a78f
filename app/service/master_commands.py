"""Named commands to the master, each in the signed log and in the event log with its outcome. Blocking; thread-safe."""

from app.configuration.write_log import WriteLog
from app.errors import LinkError
from app.service.events import Events
from app.service.links import Links
from app.words import Message
from firmware_protocol.messages import Command

NEEDED = ("charge-stop", "balance-stop", "stream-stop", "clear-faults")  # are sent although the disk takes no record


class MasterCommands:
    """Carries out what a user asked for."""

    def __init__(self, links: Links, events: Events, log: WriteLog) -> None:
        self._links = links
        self._events = events
        self._log = log

    def send(self, name: str, command: Command, who: str, details: str = "") -> None:
        """Send a named command and wait for the master's answer.

        Raises:
            LinkError: see MasterClient.request.
            RecordingFailed: the signed log does not take it, so nothing was sent; what is NEEDED is sent anyway.
        """
        text = f"{name} {details}".strip()
        try:
            with self._log.signed(who, "command", text, is_needed=name in NEEDED):
                self._links.master.request(command)
        except LinkError as error:
            self._events.note("warning", "command-failed", Message("of-source", source=text, reason=error.message), who)
            raise
        self._events.note("info", "command", Message("command", command=text), who)

    def stream(self, who: str, *, on: bool) -> None:
        """Start or stop the master's stream.

        Raises:
            LinkLost: no RS232 port is configured, or it is not open.
            RecordingFailed: see send.
        """
        name = "stream-start" if on else "stream-stop"
        with self._log.signed(who, "command", name, is_needed=name in NEEDED):
            self._links.stream(on=on)
        self._events.note("info", "command", Message("command", command=name), who)
