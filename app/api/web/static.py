"""The built front end: its files by their exact names; every other path gets its one page, which knows the routes."""

from importlib.resources.abc import Traversable
from mimetypes import guess_type
from pathlib import Path

from fastapi import FastAPI
from starlette.convertors import Convertor, register_url_convertor
from starlette.responses import FileResponse, PlainTextResponse, Response

from app.api.web.problems import not_found

# What a browser refuses to run or show under another name; Windows' registry may know these by other names.
_MEDIA_TYPES = {
    ".js": "text/javascript",
    ".css": "text/css",
    ".svg": "image/svg+xml",
    ".woff2": "font/woff2",
    ".webmanifest": "application/manifest+json",
}
_UNCHANGING = "assets"  # the build puts a hash into these names


class _PageConvertor(Convertor[str]):
    """Every path but those of the API, where a missing method is 405 and a missing route 404."""

    regex = "(?!api/).*"

    def convert(self, value: str) -> str:
        """The path as it is."""
        return value

    def to_string(self, value: str) -> str:
        """The path as it is."""
        return value


register_url_convertor("page", _PageConvertor())


def find_file(root: Traversable, path: str) -> Path | None:
    """Return the file under the root that a URL path names, None where there is none."""
    folder = Path(str(root))
    try:
        file = folder.joinpath(path).resolve()
        return file if path and file.is_relative_to(folder.resolve()) and file.is_file() else None
    except (OSError, ValueError):  # no name that a file can have
        return None


def serve_front_end(app: FastAPI, root: Traversable, page_name: str = "index.html") -> None:
    """Add the route that answers every path outside of the API, with the page of this name; it has to be the last."""

    @app.get("/{path:page}", include_in_schema=False)
    def page(path: str) -> Response:
        if file := find_file(root, path):
            kept = "public, max-age=31536000, immutable" if path.startswith(f"{_UNCHANGING}/") else "no-cache"
            media_type = _MEDIA_TYPES.get(file.suffix) or guess_type(file.name)[0]
            return FileResponse(file, headers={"Cache-Control": kept}, media_type=media_type)
        if path.startswith(f"{_UNCHANGING}/"):
            raise not_found("file", path)
        index = find_file(root, page_name)
        if index is None:
            return PlainTextResponse("The front end is not built: run `make frontend`. The API is at /api/v1.", 503)
        return FileResponse(index, headers={"Cache-Control": "no-cache"})
