"""Profiles, the history of writes with its way back, and the difference of any two configurations."""

from typing import Annotated, Any

from fastapi import APIRouter, Path, Query, Response
from pydantic import Field

from app.api.configuration.routes import MOST_FIELDS, ExpectedHash, write_response
from app.api.encoding.configuration import change_json, config_json, finding_json
from app.api.schemas.config import (
    CheckedProfileOut,
    ComparisonOut,
    ConfigHistoryOut,
    ProfilesOut,
    SourceOut,
    WriteResultOut,
)
from app.api.web.dependencies import (
    ConfigHistoryPart,
    ConfigSourcesPart,
    ConfigurationPart,
    EventsPart,
    ProfilesPart,
    RulesPart,
    UserDep,
)
from app.api.web.paging import CursorQuery, page_of
from app.api.web.problems import Problem, not_found
from app.api.web.request_body import Body
from app.configuration.config_sources import NAMES
from app.configuration.configuration_store import NoSavedConfiguration
from app.configuration.history import CONFIG_ACTIONS, Record
from app.configuration.safe_write import Draft
from app.configuration.saved_configuration import SavedConfiguration, profile_of, profile_text
from app.errors import ConfigError
from app.words import Message, render
from firmware_protocol.config_image import difference, image_hash
from firmware_protocol.memory_map import CONFIG_SIZE
from firmware_protocol.older_maps import present_image

router = APIRouter(prefix="/config", tags=["config"])
Name = Annotated[str, Path(max_length=40)]
Reference = Annotated[str, Query(max_length=120, description=render(NAMES))]


class ProfileIn(Body):
    """A configuration profile to keep under a name: a source, or a profile's file as it is."""

    source: str = Field("in-force", max_length=120, description=render(NAMES))
    profile: dict[str, Any] | None = Field(
        None, max_length=MOST_FIELDS, description="a profile's file; then the source does not count"
    )
    comment: str | None = Field(None, max_length=500)


class RollbackIn(Body):
    """The reason for a rollback."""

    reason: str = Field("", max_length=500)


def _profile_json(profile: SavedConfiguration) -> dict[str, Any]:
    return {
        "name": profile.name,
        "version": profile.version,
        "comment": profile.comment,
        "saved_by": profile.saved_by,
        "saved_at": profile.saved_at,
        "hash": image_hash(profile.image),
        "converted_from": profile.converted_from,
    }


@router.get("/profiles", response_model=ProfilesOut)
def profiles(profiles: ProfilesPart) -> dict[str, Any]:
    """The profiles, each with its newest version and the numbers of all."""
    listed: list[dict[str, Any]] = []
    broken: list[str] = []
    for name in profiles.names():
        try:
            profile = profiles.load(name)
        except (ConfigError, NoSavedConfiguration) as error:
            broken.append(f"{name}: {error}")
            continue
        listed.append(_profile_json(profile) | {"name": name, "versions": profiles.versions(name)})
    return {"profiles": listed, "broken": broken}


@router.get("/profiles/{name}", response_class=Response)
def profile_file(name: Name, profiles: ProfilesPart, version: Annotated[int | None, Query(ge=1)] = None) -> Response:
    """A profile as the file that is kept in git: units, comments, stable order."""
    profile = profiles.load(name, version)
    headers = {
        "Content-Disposition": f'attachment; filename="{profile.name}.json"',
        "ETag": f'"{image_hash(profile.image)}"',
    }
    return Response(profile_text(profile), media_type="application/json", headers=headers)


@router.put("/profiles/{name}", response_model=CheckedProfileOut)
def save_profile(
    name: Name,
    body: ProfileIn,
    events: EventsPart,
    config_sources: ConfigSourcesPart,
    profiles: ProfilesPart,
    rules: RulesPart,
    user: UserDep,
) -> dict[str, Any]:
    """Keep a configuration as the next version of a name. Nothing is written to the master."""
    if body.profile is not None:
        given = profile_of(body.profile)
        image, comment, converted_from = given.image, given.comment, given.converted_from
    else:
        image, comment, converted_from = config_sources.image(body.source), "", None
    comment = comment if body.comment is None else body.comment
    saved = profiles.save(name, image, comment=comment, who=user.name, converted_from=converted_from)
    events.note("info", "profile-saved", Message("profile-saved", profile=name, version=saved.version), user.name)
    return _profile_json(saved) | {"findings": [finding_json(issue) for issue in rules.review(image)]}


@router.delete("/profiles/{name}", status_code=204)
def delete_profile(name: Name, events: EventsPart, profiles: ProfilesPart, user: UserDep) -> None:
    """Remove a profile; its versions stay on the disk."""
    profiles.delete(name)
    events.note("info", "profile-deleted", Message("profile-deleted", profile=name), user.name)


@router.get("/source", response_model=SourceOut)
def source(name: Reference, config_sources: ConfigSourcesPart, rules: RulesPart) -> dict[str, Any]:
    """A configuration by the name of its source, in units and in raw counts, and what the rules say about it."""
    image = config_sources.image(name)
    return config_json(image) | {"findings": [finding_json(issue) for issue in rules.review(image)]}


@router.get("/compare", response_model=ComparisonOut)
def compare(a: Reference, b: Reference, config_sources: ConfigSourcesPart) -> dict[str, Any]:
    """Return the differences between two configurations."""
    first, second = config_sources.image(a), config_sources.image(b)
    return {
        "a": {"source": a, "hash": image_hash(first)},
        "b": {"source": b, "hash": image_hash(second)},
        "difference": [change_json(change) for change in difference(first, second)],
    }


def _record_json(record: Record) -> dict[str, Any]:
    knows_both = len(record.before) == len(record.after) == CONFIG_SIZE
    return {
        "number": record.number,
        "time": record.t_wall_ns / 1e9,
        "who": record.who,
        "action": record.action,
        "source": record.source,
        "reason": record.reason,
        "result": record.result,
        "from_hash": image_hash(record.before) if len(record.before) == CONFIG_SIZE else None,
        "to_hash": image_hash(record.after) if len(record.after) == CONFIG_SIZE else None,
        "difference": _difference_json(record) if knows_both else [],
        "genuine": record.is_genuine,
    }


def _difference_json(record: Record) -> list[dict[str, Any]]:
    """What a write changed, in the present memory map."""
    return [*map(change_json, difference(present_image(record.before), present_image(record.after)))]


@router.get("/history", response_model=ConfigHistoryOut)
def history(
    config_history: ConfigHistoryPart,
    limit: Annotated[int, Query(ge=1, le=1000)] = 50,
    cursor: CursorQuery = None,
) -> dict[str, Any]:
    """Every write of the configuration, newest first; `genuine` is false where a signature is not right."""
    records = [record for record in reversed(config_history.records()) if record.action in CONFIG_ACTIONS]
    shown, following = page_of(records, lambda record: (record.number, ""), limit, cursor)
    return {"records": [_record_json(record) for record in shown], "next_cursor": following}


@router.post("/history/{number}/rollback", response_model=None, responses={200: {"model": WriteResultOut}})
def roll_back(
    number: Annotated[int, Path(ge=1, le=1_000_000_000)],
    config_sources: ConfigSourcesPart,
    config_history: ConfigHistoryPart,
    configuration: ConfigurationPart,
    user: UserDep,
    expected: ExpectedHash,
    body: RollbackIn | None = None,
    dry_run: bool = False,
) -> Response:
    """Put back in force what was in force before a write; checked, verified and recorded as any other write."""
    record = config_history.record(number)
    if record is None:
        raise not_found("record", number)
    if not record.is_genuine:
        raise Problem(409, "not-genuine", Message("wrong-signature", record=number))
    image = config_sources.image(f"record:{number}:before")
    reason = (body.reason if body else "") or f"rolled back record {number}"
    draft = Draft(image, reason=reason, source=f"record {number}", action="rollback")
    written = configuration.write(draft, expected, user.name, dry_run=dry_run)
    return write_response(configuration, written, dry_run=dry_run)
