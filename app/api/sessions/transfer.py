"""Sessions from elsewhere: fetched from a recorder in the car."""

from dataclasses import asdict
from typing import Any

from fastapi import APIRouter
from pydantic import Field, SecretStr

from app.api.encoding.words import message_json, messages_json
from app.api.schemas.sessions import FetchStateOut
from app.api.web.dependencies import EventsPart, FetchesPart, UserDep
from app.api.web.request_body import Body
from app.sessions.transfer.fetch import Remote
from app.words import Message

router = APIRouter(tags=["sessions"])


class FetchIn(Body):
    """Where from, and what; without `sessions` all that are finished there and not here."""

    url: str = Field(max_length=200, description="the other service, as http://car.local:8000")
    label: str = Field("", max_length=41, description="what its sessions are called here, before their id")
    password: SecretStr | None = Field(None, description="its viewer's or engineer's")
    sessions: list[str] = Field(default_factory=list, max_length=1000)
    fill: bool = Field(True, description="fill gaps of the sessions recorded here from what was fetched")


def _answer(state: Any) -> dict[str, Any]:
    if state is None:
        return {"fetch": None}
    return {"fetch": asdict(state) | messages_json("filled", state.filled) | message_json("error", state.error)}


@router.get("/fetch", response_model=FetchStateOut)
def fetch_state(fetches: FetchesPart) -> dict[str, Any]:
    """How far the last fetch has come; null before the first."""
    return _answer(fetches.state())


@router.post("/fetch", status_code=202, response_model=FetchStateOut)
def fetch(body: FetchIn, events: EventsPart, fetches: FetchesPart, user: UserDep) -> dict[str, Any]:
    """Fetch sessions of another voltwall service; one that was cut off goes on where it stopped."""
    password = None if body.password is None else body.password.get_secret_value()
    remote = Remote(body.url, label=body.label, password=password)
    state = fetches.start(remote, body.sessions, fill=body.fill)
    events.note("info", "fetch", Message("fetch-started", url=remote.url), user.name)
    return _answer(state)
