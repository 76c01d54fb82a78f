"""A report, a black box or a reaction test as one HTML file, to print or to hand over.

The page of the front end stands in it with its data inside.

The page is `frontend/document.html`, built into one file that asks for nothing else.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from app.analysis.black_box.box import BlackBox
from app.analysis.evidence.evidence import Evidence
from app.analysis.report.report import Report
from app.errors import AppError
from app.words import Message

TEMPLATE: Final = Path(__file__).parents[1] / "static" / "document.html"
Subject = Report | BlackBox | Evidence
KINDS: Final = {Report: "report", BlackBox: "black-box", Evidence: "evidence"}
SLOT: Final = '<script type="application/json" id="data">'


class NotBuilt(AppError):
    """The page that documents are made of is missing."""

    def __init__(self) -> None:
        super().__init__(Message("document-not-built"))


def document(subject: Subject, language: str = "en") -> str:
    """Return the whole document; `language` is that of its words.

    Raises:
        NotBuilt: the front end was not built.
    """
    return page_of(KINDS[type(subject)], asdict(subject), language)


def page_of(kind: str, data: dict[str, Any], language: str) -> str:
    """Return a document of a kind that the page knows, with its data.

    Raises:
        NotBuilt: the front end was not built.
    """
    try:
        page = TEMPLATE.read_text(encoding="utf-8")
    except OSError as error:
        raise NotBuilt from error
    body = json.dumps({"kind": kind, "language": language, "data": data}, separators=(",", ":"))
    return page.replace(SLOT, SLOT + body.replace("<", "\\u003c"), 1)  # no end of the script within its data
