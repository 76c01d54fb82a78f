"""Errors of recording and reading sessions.

SessionError
  SessionNotFound    no such session in the folder
  NotASession        the file is no session, or damaged beyond reading
  SchemaTooNew       written by a newer version of the program
  UnknownSignal      the name means nothing, or the element does not exist
  RecordingFailed    what was to be recorded is not on the disk
  FetchFailed        another service's session did not come over whole
  ExportUnavailable  an export format needs a package that is not installed
"""

from app.errors import AppError, ExtraMissing, shown
from app.words import Message, Text

NO_SIGNAL = Message("no-such-signal")


class SessionError(AppError):
    """Root of all errors of sessions and of the event log."""


class SessionNotFound(SessionError):
    """No session has this id."""

    def __init__(self, session_id: str) -> None:
        self.session_id = session_id
        super().__init__(Message("no-session", session=shown(session_id)))


class NotASession(SessionError):
    """The file cannot be read as what it should be."""

    def __init__(self, path: str, reason: Text) -> None:
        self.path = path
        self.reason = reason
        super().__init__(Message("of-source", source=path, reason=reason))


class SchemaTooNew(SessionError):
    """The file's schema is newer than this program."""

    def __init__(self, path: str, schema: int, supported: int) -> None:
        self.path = path
        self.schema = schema
        self.supported = supported
        super().__init__(Message("schema-too-new", path=path, schema=schema, supported=supported))


Unreadable = NotASession | SchemaTooNew


class UnknownSignal(SessionError):
    """No signal has this name."""

    def __init__(self, name: str, reason: Text = NO_SIGNAL) -> None:
        self.name = name
        self.reason = reason
        super().__init__(Message("of-source", source=shown(name), reason=reason))


class RecordingFailed(SessionError):
    """Recorded items are waiting in memory because the disk does not take them."""


class FetchFailed(SessionError):
    """A session of another service is not here, or not all of it."""

    def __init__(self, url: str, reason: Text) -> None:
        self.url = url
        self.reason = reason
        super().__init__(Message("of-source", source=url, reason=reason))


class ExportUnavailable(SessionError, ExtraMissing):
    """An export format needs a package that is not installed."""
