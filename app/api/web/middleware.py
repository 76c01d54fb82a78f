"""Middleware of all requests: the size that a client may send, HEAD as GET, headers against foreign content."""

from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.types import Message as HttpMessage

from app.api.web.problems import HttpRefusal, Problem
from app.words import Message

_CSP = b"content-security-policy"
_POLICY = (
    "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; connect-src 'self'; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'self'"
)
MAX_BODY_BYTES = 1 << 20  # a configuration is 420 bytes, all CAN tables as JSON a few kilobytes


UPLOAD_PATH = "/api/v1/imports"
_DIGITS = 15  # digits of a length; more exceed every limit
MAX_UPLOAD_BYTES = 1 << 31  # a recording of another system; it goes to the disk piece by piece


class BodyLimit:
    """ASGI middleware: 413 by the announced length, or as soon as more has come."""

    def __init__(self, app: ASGIApp, max_bytes: int = MAX_BODY_BYTES) -> None:
        self._app = app
        self._max_bytes = max_bytes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Count what comes in."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        limit = MAX_UPLOAD_BYTES if scope["path"] == UPLOAD_PATH else self._max_bytes
        announced = next((value for name, value in scope["headers"] if name == b"content-length"), b"0")
        detail = Message("request-too-large", limit=limit)
        if announced.isdigit() and (len(announced) > _DIGITS or int(announced) > limit):
            await Problem(413, "too-large", detail).response()(scope, receive, send)
            return
        taken = 0

        async def counted() -> HttpMessage:
            nonlocal taken
            message = await receive()
            taken += len(message.get("body", b""))
            if taken > limit:
                raise HttpRefusal(413, detail)
            return message

        await self._app(scope, counted, send)


class RequestFraming:
    """ASGI middleware: 400, and the end of the connection, where a request states the end of its body twice.

    A proxy before the service and the service have to agree on it. h11 refuses lengths that differ and codings that it
    does not know; a length next to a coding it ignores, and takes what follows for the next request.
    """

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


class HeadAsGet:
    """ASGI middleware: the route is run as for GET; the server leaves the body out."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Hand the request on."""
        is_head = scope["type"] == "http" and scope["method"] == "HEAD"
        await self._app({**scope, "method": "GET"} if is_head else scope, receive, send)


class SecurityHeaders:
    """ASGI middleware: nothing foreign is loaded, nothing is framed, nothing is guessed, no data stays in a cache."""

    def __init__(self, app: ASGIApp, *, has_name: bool) -> None:
        self._app = app
        self._has_name = has_name  # beyond loopback: "localhost" is every program's of a computer

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Add the headers to every HTTP response."""

        async def with_headers(message: HttpMessage) -> None:
            if message["type"] == "http.response.start":
                given = {name for name, _ in message["headers"]}
                own = [] if _CSP in given else [(_CSP, _POLICY.encode())]
                if b"cache-control" not in given:
                    own.append((b"cache-control", b"no-store"))
                if scope["scheme"] == "https" and self._has_name:
                    own.append((b"strict-transport-security", b"max-age=31536000"))
                message["headers"] = [
                    *message["headers"],
                    *own,
                    (b"x-content-type-options", b"nosniff"),
                    (b"referrer-policy", b"same-origin"),
                ]
            await send(message)

        await self._app(scope, receive, with_headers if scope["type"] == "http" else send)
