"""Access for phones, turned on and off by a chief; before there is one, by the engineer at this machine."""

from fastapi import APIRouter
from pydantic import BaseModel

from app.api.web.authentication import Authentication, User
from app.api.web.dependencies import AuthenticationPart, EventsPart, PhonesPart, UserDep
from app.api.web.problems import Problem
from app.api.web.request_body import Body
from app.errors import NotNow
from app.words import Message, RenderedMessage, rendered

router = APIRouter(tags=["login"])


class PhonesIn(Body):
    """Access of phones on the network, on or off."""

    is_on: bool


class PhonesOut(BaseModel):
    """Access for phones; `is_possible` is false where the service listens on the network itself, or cannot.

    `missing` names what has to be done before it can be turned on.
    """

    is_on: bool
    is_possible: bool
    urls: list[str]
    fingerprint: str | None
    missing: list[RenderedMessage]


def _missing(authentication: Authentication, user: User) -> list[Message]:
    if authentication.is_open:
        return [Message("phones-need-password")]
    is_chief = user.role == "chief" or (user.role == "engineer" and not authentication.accounts.has_chief)
    return [] if is_chief and user.token_id is None else [Message("chief-turns-phones-on")]


def _phones(phones: PhonesPart, authentication: Authentication, user: User) -> PhonesOut:
    return PhonesOut(
        is_on=phones.port is not None,
        is_possible=phones.is_possible,
        urls=phones.urls,
        fingerprint=None if phones.certificate is None else phones.certificate.fingerprint,
        missing=[*map(rendered, _missing(authentication, user))],
    )


@router.get("/phones")
def phones(phones: PhonesPart, authentication: AuthenticationPart, user: UserDep) -> PhonesOut:
    """Addresses for phones, or what is missing."""
    return _phones(phones, authentication, user)


@router.put("/phones")
def put_phones(
    body: PhonesIn, phones: PhonesPart, authentication: AuthenticationPart, events: EventsPart, user: UserDep
) -> PhonesOut:
    """Listen on every address of this machine by HTTPS, or no longer; the service runs on."""
    missing = _missing(authentication, user)
    if missing and authentication.is_open:
        raise NotNow(missing[0])
    if missing:
        raise Problem(403, "chief-required", missing[0])
    if not phones.is_possible:
        raise NotNow(Message("phones-not-needed"))
    with authentication.log.changed(user.name, f"phones: {'on' if body.is_on else 'off'}"):
        if body.is_on:
            phones.turn_on()
        else:
            phones.turn_off()
    if body.is_on:
        events.note("info", "phones-on", Message("phones-on", urls=tuple(phones.urls)), who=user.name)
    else:
        events.note("info", "phones-off", Message("phones-off"), who=user.name)
    return _phones(phones, authentication, user)
