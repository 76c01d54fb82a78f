"""A session's signals as files that other programs open."""

from app.sessions.export.formats import FORMATS, Format, export
from app.sessions.export.table import Rows, SignalTable

__all__ = ["FORMATS", "Format", "Rows", "SignalTable", "export"]
