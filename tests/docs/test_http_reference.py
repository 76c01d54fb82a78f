"""The HTTP reference names every route, and no route that does not exist."""

import re
from pathlib import Path

from app.api.application import create_app
from app.service.settings import Settings

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "http.md"


def routes(tmp_path):
    app = create_app(Settings(data=tmp_path, serial="loop://"), "serial", serial_url=None, can_url=None)
    app.state.parts.service.stop()
    schema = app.openapi()["paths"]
    return {(method.upper(), path.removeprefix("/api/v1")) for path, methods in schema.items() for method in methods}


def test_every_route_is_in_the_reference_and_the_reference_names_no_other(tmp_path):
    text = PAGE.read_text(encoding="utf-8")
    told = {
        (method, re.sub(r"\?.*", "", path)) for method, path in re.findall(r"`(GET|POST|PUT|DELETE) (/[^` ]*)", text)
    }
    assert told == routes(tmp_path)
