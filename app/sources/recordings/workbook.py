"""The largest sheet of an Excel file as lines of text: test rigs write their records into one of several."""

from datetime import date, datetime, time, timedelta
from importlib import import_module
from pathlib import Path

from app.errors import ExtraMissing
from app.sources.recordings.csv_table import TableUnreadable
from app.words import Message


def largest_sheet(path: Path) -> tuple[str, bytes]:
    """Return the name of the sheet with the most cells, and its rows as text with tabs between the columns.

    Raises:
        TableUnreadable: the file cannot be read.
        ExtraMissing: python-calamine is not installed.
    """
    try:
        calamine = import_module("python_calamine")
    except ImportError as error:
        raise ExtraMissing("an Excel file", "python-calamine", "excel") from error
    try:
        with path.open("rb") as file:  # by a path it goes by the ending
            book = calamine.CalamineWorkbook.from_filelike(file)
        sheets = {name: book.get_sheet_by_name(name).to_python() for name in book.sheet_names}
    except Exception as error:  # calamine has a class for each part of the format
        raise TableUnreadable(path.name, Message("cannot-be-read", error=str(error))) from error
    name, rows = max(sheets.items(), key=lambda sheet: sum(len(row) for row in sheet[1]), default=("", []))
    return name, "\n".join("\t".join(map(_text, row)) for row in rows).encode()


def _text(value: object) -> str:
    match value:
        case timedelta():
            return repr(value.total_seconds())
        case datetime() | date() | time():
            return value.isoformat()
        case _:
            return str(value).replace("\t", " ").replace("\n", " ")
