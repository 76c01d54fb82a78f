"""One error body for the whole API: RFC 9457 problem documents, from one table."""

import errno
import logging
import math
from collections.abc import Mapping
from dataclasses import asdict
from functools import reduce
from pathlib import Path
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException

from app.analysis.document import NotBuilt
from app.api.encoding.configuration import change_json, finding_json
from app.configuration.config_sources import NoSource
from app.configuration.configuration_store import NoSavedConfiguration
from app.configuration.safe_write import Busy, HashMismatch, ReasonRequired, Rejected, Unverified
from app.errors import (
    AppError,
    ConfigError,
    ExtraMissing,
    ImportFailed,
    LimitExceeded,
    LinkError,
    LinkLost,
    MasterRefused,
    MasterSilent,
    NotNow,
    limit_of,
    validation_text,
)
from app.sessions.errors import NotASession, SchemaTooNew, SessionError, SessionNotFound
from app.sources.data_file import encodable
from app.words import Message, RenderedMessage, Text, render, rendered, table
from firmware_protocol.config_image import difference, image_hash
from firmware_protocol.errors import EncodeError
from firmware_protocol.memory_map import CONFIG_SIZE, element_name, locate

log = logging.getLogger(__name__)
MEDIA_TYPE = "application/problem+json"
HTTP_SLUGS = {400: "bad-request", 404: "not-found", 405: "method-not-allowed", 413: "too-large"}
REFUSED_BY_DISK = {errno.ENOSPC, errno.EROFS, errno.EFBIG, getattr(errno, "EDQUOT", errno.ENOSPC)}
SHOWN = 200  # characters of a value that is shown back
MOST_ERRORS = 20  # fields at fault that an answer names


HTTP_DETAILS = {  # what the framework says by itself
    "Method Not Allowed": Message("problem-method-not-allowed"),
    "There was an error parsing the body": Message("body-not-parsed"),
}


class HttpRefusal(HTTPException):
    """A Problem that the framework lets pass where it reads a request's body."""

    def __init__(self, status: int, message: Message) -> None:
        self.message = message
        super().__init__(status, render(message))


class Problem(Exception):
    """Raised by a route to answer with a problem document."""

    def __init__(
        self, status: int, slug: str, detail: Message, headers: Mapping[str, str] | None = None, **extra: Any
    ) -> None:
        self.status = status
        self.slug = slug
        self.detail = detail
        self.headers = headers
        self.extra = extra
        super().__init__(render(detail))

    def response(self) -> JSONResponse:
        """Return the document."""
        message, title = rendered(self.detail), table("en")[f"problem-{self.slug}"]
        body = {
            "type": f"urn:voltwall:{self.slug}",
            "title": title,
            "status": self.status,
            "detail": message.text,
            "message": message,
        }
        return JSONResponse(_plain(body | self.extra), self.status, headers=self.headers, media_type=MEDIA_TYPE)


def _plain(value: Any) -> Any:
    """The value as JSON can carry it: whatever a client sent (NaN, half a surrogate pair, a megabyte) is shown back."""
    if isinstance(value, RenderedMessage):
        value = asdict(value)
    if isinstance(value, dict):
        return {_plain(str(name)): _plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value)
    if isinstance(value, str):
        return value.encode(errors="replace").decode()
    return value if isinstance(value, int | None) else _shown(value)


def _shown(value: object) -> str:
    text = value if isinstance(value, str) else repr(value)
    return text if len(text) <= SHOWN else text[:SHOWN] + "..."


_KINDS = {
    "account": Message("an-account"),
    "alarm": Message("an-alarm"),
    "black box": Message("a-black-box"),
    "command": Message("a-command"),
    "event": Message("an-event"),
    "file": Message("a-file"),
    "profile-draft": Message("a-profile-draft"),
    "reaction test": Message("a-reaction-test"),
    "login": Message("a-login"),
    "record": Message("a-record"),
    "route": Message("a-route"),
    "scenario": Message("a-scenario"),
    "session": Message("a-session"),
    "swap": Message("a-swap"),
    "token": Message("a-token"),
}


def not_found(kind: str, name: object) -> Problem:
    """404."""
    return Problem(404, "not-found", Message("not-found", kind=_KINDS[kind], name=_shown(name)))


def invalid(field: str, value: object, limit: Text) -> Problem:
    """422 for one field."""
    text = _shown(render(value) if isinstance(value, Message) else value)
    given = value if isinstance(value, int | float | None) else text
    message = Message("not-allowed", field=field, value=value if isinstance(value, Message) else text, limit=limit)
    error = {"field": field, "value": given, "limit": rendered(limit), "message": rendered(message)}
    return Problem(422, "invalid", message, errors=[error])


def _of_app_error(error: AppError) -> Problem:
    match error:
        case HashMismatch():
            return _changed_meanwhile(error)
        case Rejected():
            return Problem(422, "invalid", error.message, errors=[*map(finding_json, error.findings)])
        case ReasonRequired():
            warnings = [*map(finding_json, error.findings)]
            return Problem(422, "reason-required", error.message, errors=warnings)
        case Busy():
            return Problem(409, "at-work", error.message, doing=error.doing, fields=error.fields)
        case Unverified():
            return Problem(504, "not-verified", error.message, in_force=error.outcome)
        case MasterRefused():
            return Problem(409, "refused", error.message, **_at_fault(error))
        case MasterSilent():
            return Problem(504, "no-reply", error.message)
        case LinkLost() | LinkError():
            return Problem(503, "link-lost", error.message)
        case NoSavedConfiguration() | NoSource() | SessionNotFound():
            return Problem(404, "not-found", error.message)
        case ImportFailed():
            return Problem(422, "not-importable", error.message)
        case ExtraMissing() | NotBuilt():
            return Problem(501, "extra-missing", error.message)
        case NotASession() | SchemaTooNew():
            return Problem(422, "unreadable-session", error.message)
        case SessionError():
            return Problem(507, "storage", error.message)
        case LimitExceeded():
            return Problem(413, "too-large", error.message)
        case NotNow():
            return Problem(409, "not-now", error.message)
        case ConfigError():
            return invalid(error.field, error.value, error.limit)
    return Problem(500, "failed", error.message)


def _changed_meanwhile(error: HashMismatch) -> Problem:
    """412 with both differences: what changed since the draft was begun, and what the draft would change now."""
    meanwhile = None if error.base is None else [*map(change_json, difference(error.base, error.in_force))]
    in_force = image_hash(error.in_force)
    return Problem(
        412,
        "changed-meanwhile",
        error.message,
        {"ETag": f'"{in_force}"'},
        expected=error.expected,
        in_force=in_force,
        meanwhile=meanwhile,
        difference=[*map(change_json, difference(error.in_force, error.wanted))],
    )


def _at_fault(error: MasterRefused) -> dict[str, Any]:
    extra: dict[str, Any] = {"result": error.result}
    if error.offset is not None and error.offset < CONFIG_SIZE and (place := locate(error.offset)):
        field, element, _ = place
        extra["offset"] = error.offset
        extra["field"] = element_name(field, element)
    return extra


def _number(value: object) -> int | float | None:
    return value if isinstance(value, int | float) else None


def _place(error: Mapping[str, Any]) -> str:
    return ".".join(str(part) for part in error["loc"][1:]) or str(error["loc"][0])


def install(app: FastAPI) -> None:
    """Make every error of the application a problem document."""

    @app.exception_handler(Problem)
    async def on_problem(_: Request, error: Problem) -> JSONResponse:
        return error.response()

    @app.exception_handler(AppError)
    async def on_app_error(_: Request, error: AppError) -> JSONResponse:
        return _of_app_error(error).response()

    @app.exception_handler(OSError)
    async def on_os_error(request: Request, error: OSError) -> JSONResponse:
        if error.errno not in REFUSED_BY_DISK:
            raise error
        what = request.scope["path"] if error.filename is None else Path(str(error.filename)).name
        message = Message("not-stored", file=encodable(what), error=error.strerror or str(error))
        return Problem(507, "storage", message).response()

    @app.exception_handler(EncodeError)
    async def on_encode_error(_: Request, error: EncodeError) -> JSONResponse:
        return invalid(error.field, error.value, limit_of(error)).response()

    @app.exception_handler(HTTPException)
    async def on_http(request: Request, error: HTTPException) -> JSONResponse:
        if error.status_code == 404:
            return not_found("route", request.scope["path"]).response()
        slug = HTTP_SLUGS.get(error.status_code, "http")
        detail = error.message if isinstance(error, HttpRefusal) else HTTP_DETAILS.get(str(error.detail))
        detail = detail or Message("verbatim", text=str(error.detail))
        return Problem(error.status_code, slug, detail, error.headers).response()

    @app.exception_handler(RequestValidationError)
    async def on_validation(_: Request, error: RequestValidationError) -> JSONResponse:
        invalid = error.errors()[:MOST_ERRORS]
        errors = [
            {
                "field": _shown(_place(e)),
                "value": _shown(e["input"]) if isinstance(e.get("input"), str) else _number(e.get("input")),
                "limit": rendered(validation_text(e)),
                "message": rendered(validation_text(e)),
            }
            for e in invalid
        ]
        messages = [Message("of-source", source=_shown(_place(e)), reason=validation_text(e)) for e in invalid]
        detail = reduce(lambda first, second: Message("also", first=first, second=second), messages)
        return Problem(422, "invalid", detail, errors=errors).response()

    @app.exception_handler(Exception)
    async def on_bug(_: Request, error: Exception) -> JSONResponse:
        log.error("a request failed", exc_info=error)
        return Problem(500, "failed", Message("request-failed")).response()
