"""How much a client may send: requests here are small, and what is larger is refused before it fills the memory."""

from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.types import Message as HttpMessage

from app.api.web.problems import HttpRefusal, Problem
from app.words import Message

MAX_BODY_BYTES = 1 << 20  # a configuration is 420 bytes, all CAN tables as JSON a few kilobytes


UPLOAD_PATH = "/api/v1/imports"
_DIGITS = 15  # of a length; beyond them every limit is exceeded
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
