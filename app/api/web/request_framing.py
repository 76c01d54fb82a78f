"""Where a request's body ends: one statement of it, on which a proxy before the service and the service agree.

h11 refuses lengths that differ and codings that it does not know; a length next to a coding it ignores, and takes what
follows for the next request.
"""

from starlette.types import ASGIApp, Receive, Scope, Send

from app.api.web.problems import Problem
from app.words import Message


class RequestFraming:
    """ASGI middleware: 400, and the end of the connection, where a request states the end of its body twice."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let the request through, or answer it."""
        if scope["type"] == "http":
            names = {name for name, _ in scope["headers"]}
            is_chunked = b"transfer-encoding" in names
            if is_chunked and (b"content-length" in names or scope["http_version"] == "1.0"):
                problem = Problem(400, "bad-request", Message("two-lengths"), {"Connection": "close"})
                await problem.response()(scope, receive, send)
                return
        await self._app(scope, receive, send)
