"""The configuration in force and in the EEPROM: read, compare, write, store."""

from typing import Annotated, Any

import orjson
from fastapi import APIRouter, Depends, Header, Query, Request, Response
from pydantic import Field, ValidationError

from app.api.encoding.configuration import change_json, config_json, finding_json, schema_json
from app.api.schemas.config import ConfigOut, LoadResultOut, SchemaOut, StoredConfigOut, StoreResultOut, WriteResultOut
from app.api.web.dependencies import ConfigSourcesPart, ConfigurationPart, InForcePart, RulesPart, UserDep
from app.api.web.problems import Problem, invalid
from app.api.web.request_body import Body, RawBody
from app.configuration.config_sources import ConfigSources
from app.configuration.safe_write import ConfigurationWriter, Draft, Written
from app.configuration.saved_configuration import is_profile, profile_of
from app.errors import validation_text
from app.words import Message, rendered_or_none
from firmware_protocol.config_image import image_hash
from firmware_protocol.memory_map import CONFIG, CONFIG_SIZE
from firmware_protocol.older_maps import FIRST_MAP, is_first_image, present_image

router = APIRouter(prefix="/config", tags=["config"])
OCTETS = "application/octet-stream"
MOST_FIELDS = 1000  # fields in a request; a configuration has fewer


class ConfigEdit(Body):
    """Fields to change, in units or in raw counts; what is not named stays.

    Or everything from a named source: `profile:wet-race`, `record:7:before`, `stored`, `default`, `session:ID`.
    """

    values: dict[str, Any] = Field(default_factory=dict, max_length=MOST_FIELDS)
    raw: dict[str, Any] = Field(default_factory=dict, max_length=MOST_FIELDS)
    source: str | None = Field(None, max_length=120)
    reason: str = Field("", max_length=500, description="why it is right in spite of warnings")


_PUT_BODY = {
    "requestBody": {
        "required": True,
        "content": {
            "application/json": {"schema": ConfigEdit.model_json_schema()},
            OCTETS: {"schema": {"type": "string", "format": "binary"}},
        },
    }
}


def quoted(text: str) -> str:
    """An ETag."""
    return f'"{text}"'


async def _expected_hash(if_match: Annotated[str | None, Header()] = None) -> str:
    if if_match is None:
        raise Problem(428, "if-match-required", Message("if-match-needed"))
    tag = if_match.strip()
    return "" if tag.startswith("W/") else tag.strip('"')  # a weak one never matches: RFC 9110, 13.1.1


ExpectedHash = Annotated[str, Depends(_expected_hash)]  # hash of the image that the client's draft started from


@router.get("/schema", response_model=SchemaOut)
def schema() -> dict[str, Any]:
    """Every field with type, unit, range, default and meaning; and the whole memory map for the CAN picker."""
    return schema_json()


@router.get("", response_model=None, responses={200: {"model": ConfigOut}})
def read(
    request: Request, in_force: InForcePart, configuration: ConfigurationPart, rules: RulesPart
) -> Response | dict[str, Any]:
    """The configuration in force: JSON in units, or the 420 bytes with Accept: application/octet-stream."""
    image = in_force.image()
    if image is None:
        raise Problem(503, "link-lost", Message("config-never-read"))
    etag = quoted(configuration.show(image))
    if OCTETS in request.headers.get("accept", ""):
        return Response(image, media_type=OCTETS, headers={"ETag": etag})
    findings = [finding_json(issue) for issue in rules.review(image)]
    body = config_json(image) | {
        "stored_hash": in_force.stored_hash(),
        "age_s": in_force.age_s(),
        "findings": findings,
        "allowed": rules.allowed_ranges(image),
    }
    return Response(orjson.dumps(body), media_type="application/json", headers={"ETag": etag})


@router.get("/stored", response_model=None, responses={200: {"model": StoredConfigOut | None}})
def read_stored(request: Request, configuration: ConfigurationPart) -> Response | dict[str, Any] | None:
    """Return the configuration in the EEPROM, read now; null, or no content, where it holds no valid one."""
    stored = configuration.read_stored()
    if stored is None:
        return Response(status_code=204) if OCTETS in request.headers.get("accept", "") else None
    if OCTETS in request.headers.get("accept", ""):
        return Response(stored.image, media_type=OCTETS, headers={"ETag": quoted(image_hash(stored.image))})
    return config_json(stored.image) | {"counter": stored.counter}


@router.put("", openapi_extra=_PUT_BODY, responses={200: {"model": WriteResultOut}})
def write(
    request: Request,
    body: RawBody,
    configuration: ConfigurationPart,
    config_sources: ConfigSourcesPart,
    user: UserDep,
    expected: ExpectedHash,
    dry_run: bool = False,
    reason: Annotated[str, Query(max_length=500)] = "",
) -> Response:
    """Write fields (JSON), a profile (JSON) or the whole image (octet-stream), and read it back.

    `dry_run` only checks and compares. Errors block; a warning that is new needs a `reason`.
    """
    draft = _draft(body, OCTETS in request.headers.get("content-type", ""), reason, config_sources)
    written = configuration.write(draft, expected, user.name, dry_run=dry_run)
    return write_response(configuration, written, dry_run=dry_run)


def _draft(body: bytes, is_image: bool, reason: str, config_sources: ConfigSources) -> Draft:
    """An image, a profile's file, or fields to change in what is in force or in a named source."""
    if is_image:
        if len(body) != CONFIG_SIZE:
            raise invalid("body", Message("bytes", count=len(body)), Message("exactly-bytes", count=CONFIG_SIZE))
        source = f"image, converted from map {FIRST_MAP}" if is_first_image(body) else "image"
        return Draft(present_image(body), reason=reason, source=source)
    try:
        document = orjson.loads(body)
    except orjson.JSONDecodeError as error:
        raise invalid("body", body[:80].decode(errors="replace"), f"JSON: {error}") from error
    if is_profile(document):
        profile = profile_of(document)
        return Draft(profile.image, reason=reason, source=f"file {profile.origin}")
    try:
        edit = ConfigEdit.model_validate(document)
    except ValidationError as error:
        first = error.errors()[0]
        raise invalid(
            ".".join(map(str, first["loc"])) or "body", str(first.get("input"))[:80], validation_text(first)
        ) from error
    for name, value in (*edit.raw.items(), *edit.values.items()):
        if name not in CONFIG:
            raise invalid(name, value, Message("no-config-field"))
        if name in edit.values and name in edit.raw:
            raise invalid(name, value, Message("values-or-raw"))
    base = None if edit.source in (None, "in-force") else config_sources.image(edit.source)
    return Draft(base, edit.values, edit.raw, reason=edit.reason or reason, source=edit.source or "draft")


def write_response(configuration: ConfigurationWriter, written: Written, *, dry_run: bool) -> Response:
    """Answer with the difference and what the rules say."""
    shown = written.before if dry_run else written.image  # what is in force now
    body = {
        "difference": [change_json(change) for change in written.changes],
        "written": written.written,
        "dry_run": dry_run,
        "verified": not dry_run,  # without a difference it was read and found equal
        "hash": image_hash(written.image),
        "warnings": [finding_json(issue) for issue in written.findings],
        "block_reason": rendered_or_none(written.block_reason),
    }
    etag = quoted(configuration.show(shown))
    return Response(orjson.dumps(body), media_type="application/json", headers={"ETag": etag})


@router.post("/store", response_model=StoreResultOut)
def store(configuration: ConfigurationPart, user: UserDep) -> dict[str, Any]:
    """Store the configuration in force in the EEPROM and read it back."""
    stored = configuration.store(user.name)
    return {"stored_hash": image_hash(stored.image), "verified": True, "counter": stored.counter}


@router.post("/load", response_model=LoadResultOut)
def load(configuration: ConfigurationPart, user: UserDep) -> dict[str, Any]:
    """Put the stored configuration in force."""
    return {"hash": image_hash(configuration.load(user.name))}
