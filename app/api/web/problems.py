"""One error body for the whole API: RFC 9457 problem documents, from one table."""

import logging
import math
from collections.abc import Mapping
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException

from app.api.encoding.configuration import change_json, finding_json
from app.configuration.lookup import NoSource
from app.configuration.profile_store import NoProfile
from app.configuration.refusals import HashMismatch, Occupied, ReasonRequired, Rejected, Unverified
from app.errors import (
    AppError,
    ConfigError,
    ExtraMissing,
    ImportFailed,
    LinkError,
    LinkLost,
    MasterRefused,
    MasterSilent,
    NotNow,
)
from app.sessions.errors import NotASession, SchemaTooNew, SessionError, SessionNotFound
from firmware_protocol.config_image import difference, image_hash
from firmware_protocol.errors import EncodeError
from firmware_protocol.memory_map import CONFIG_SIZE, element_name, locate

log = logging.getLogger(__name__)
MEDIA_TYPE = "application/problem+json"
SHOWN = 200  # characters of a value that is shown back


class Problem(Exception):
    """Raised by a route to answer with a problem document."""

    def __init__(
        self, status: int, slug: str, title: str, detail: str, headers: Mapping[str, str] | None = None, **extra: Any
    ) -> None:
        self.status = status
        self.slug = slug
        self.title = title
        self.detail = detail
        self.headers = headers
        self.extra = extra
        super().__init__(detail)

    def response(self) -> JSONResponse:
        """Return the document."""
        body = {"type": f"urn:voltwall:{self.slug}", "title": self.title, "status": self.status, "detail": self.detail}
        return JSONResponse(_plain(body | self.extra), self.status, headers=self.headers, media_type=MEDIA_TYPE)


def _plain(value: Any) -> Any:
    """The value as JSON can carry it: whatever a client sent (NaN, half a surrogate pair, a megabyte) is shown back."""
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


def not_found(what: str, name: object) -> Problem:
    """404."""
    return Problem(404, "not-found", "Not found", f"no {what} {name}")


def invalid(field: str, value: object, limit: str) -> Problem:
    """422 for one field."""
    message = f"{field} = {_shown(value)}: {limit}"
    shown = value if isinstance(value, int | float | None) else _shown(value)
    error = {"field": field, "value": shown, "limit": limit, "message": message}
    return Problem(422, "invalid", "Invalid value", message, errors=[error])


def _of_app_error(error: AppError) -> Problem:
    match error:
        case HashMismatch():
            return _changed_meanwhile(error)
        case Rejected():
            return Problem(422, "invalid", "Invalid value", str(error), errors=[*map(finding_json, error.findings)])
        case ReasonRequired():
            warnings = [*map(finding_json, error.findings)]
            return Problem(422, "reason-required", "A reason is needed", str(error), errors=warnings)
        case Occupied():
            return Problem(409, "at-work", "Not while at work", str(error), doing=error.doing, fields=error.fields)
        case Unverified():
            return Problem(504, "not-verified", "Not verified", str(error), in_force=error.outcome)
        case MasterRefused():
            return Problem(409, "refused", "Refused by the master", str(error), **_at_fault(error))
        case MasterSilent():
            return Problem(504, "no-reply", "No reply from the master", str(error))
        case LinkLost() | LinkError():
            return Problem(503, "link-lost", "Link lost", str(error))
        case NoProfile() | NoSource() | SessionNotFound():
            return Problem(404, "not-found", "Not found", str(error))
        case ImportFailed():
            return Problem(422, "not-importable", "Cannot be imported", str(error))
        case ExtraMissing():
            return Problem(501, "extra-missing", "Optional package missing", str(error))
        case NotASession() | SchemaTooNew():
            return Problem(422, "unreadable-session", "Unreadable session", str(error))
        case SessionError():
            return Problem(507, "storage", "Storage", str(error))
        case NotNow():
            return Problem(409, "not-now", "Not now", str(error))
        case ConfigError():
            return invalid(error.field, error.value, error.limit)
    return Problem(500, "failed", "Failed", str(error))


def _changed_meanwhile(error: HashMismatch) -> Problem:
    """412 with both differences: what changed since the draft was begun, and what the draft would change now."""
    meanwhile = None if error.base is None else [*map(change_json, difference(error.base, error.in_force))]
    in_force = image_hash(error.in_force)
    return Problem(
        412,
        "changed-meanwhile",
        "Changed meanwhile",
        str(error),
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


def _document(app: FastAPI) -> None:
    """Say in the OpenAPI document under which media type problems come."""
    made = app.openapi

    def openapi() -> dict[str, Any]:
        document = made()
        for operation in (operation for path in document["paths"].values() for operation in path.values()):
            problem = operation["responses"]["default"]
            problem["content"] = {MEDIA_TYPE: next(iter(problem["content"].values()))}
        return document

    app.openapi = openapi  # type: ignore[method-assign]


def install(app: FastAPI) -> None:
    """Make every error of the application a problem document."""
    _document(app)

    @app.exception_handler(Problem)
    async def on_problem(_: Request, error: Problem) -> JSONResponse:
        return error.response()

    @app.exception_handler(AppError)
    async def on_app_error(_: Request, error: AppError) -> JSONResponse:
        return _of_app_error(error).response()

    @app.exception_handler(EncodeError)
    async def on_encode_error(_: Request, error: EncodeError) -> JSONResponse:
        return invalid(error.field, error.value, error.limit).response()

    @app.exception_handler(HTTPException)
    async def on_http(_: Request, error: HTTPException) -> JSONResponse:
        slug = {400: "bad-request", 404: "not-found", 405: "method-not-allowed", 413: "too-large"}
        text = str(error.detail)
        return Problem(error.status_code, slug.get(error.status_code, "http"), text, text, error.headers).response()

    @app.exception_handler(RequestValidationError)
    async def on_validation(_: Request, error: RequestValidationError) -> JSONResponse:
        errors = [
            {
                "field": ".".join(str(part) for part in e["loc"][1:]) or str(e["loc"][0]),
                "value": _shown(e["input"]) if isinstance(e.get("input"), str) else _number(e.get("input")),
                "limit": e["msg"].removeprefix("Input should be "),
                "message": e["msg"],
            }
            for e in error.errors()
        ]
        detail = "; ".join(f"{e['field']}: {e['message']}" for e in errors)
        return Problem(422, "invalid", "Invalid value", detail, errors=errors).response()

    @app.exception_handler(Exception)
    async def on_bug(_: Request, error: Exception) -> JSONResponse:
        log.error("a request failed", exc_info=error)
        return Problem(500, "failed", "Failed", "the service failed on this request; its log says why").response()
