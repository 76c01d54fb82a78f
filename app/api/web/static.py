"""The built front end: its files by their exact names; every other path gets its one page, which knows the routes."""

from importlib.resources.abc import Traversable
from mimetypes import guess_type
from pathlib import Path

from fastapi import FastAPI
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


def find_file(root: Traversable, path: str) -> Path | None:
    """Return the file under the root that a URL path names, None where there is none."""
    folder = Path(str(root))
    try:
        found = folder.joinpath(path).resolve()
        return found if path and found.is_relative_to(folder.resolve()) and found.is_file() else None
    except (OSError, ValueError):  # no name that a file can have
        return None


def serve_front_end(app: FastAPI, root: Traversable, page_name: str = "index.html") -> None:
    """Add the catch-all route, which answers with the page of this name; it has to be the last one."""

    @app.get("/{path:path}", include_in_schema=False)
    def page(path: str) -> Response:
        if path.startswith("api/"):
            raise not_found("route", "/" + path)
        if found := find_file(root, path):
            kept = "public, max-age=31536000, immutable" if path.startswith(f"{_UNCHANGING}/") else "no-cache"
            media_type = _MEDIA_TYPES.get(found.suffix) or guess_type(found.name)[0]
            return FileResponse(found, headers={"Cache-Control": kept}, media_type=media_type)
        if path.startswith(f"{_UNCHANGING}/"):
            raise not_found("file", path)
        index = find_file(root, page_name)
        if index is None:
            return PlainTextResponse("The front end is not built: run `make frontend`. The API is at /api/v1.", 503)
        return FileResponse(index, headers={"Cache-Control": "no-cache"})
