"""A session's signals as files that other programs open."""

from app.sessions.export.formats import FORMATS, Format, export
from app.sessions.export.table import Block, SignalTable, column_name

__all__ = ["FORMATS", "Block", "Format", "SignalTable", "column_name", "export"]
