"""Who am I, log in, log out."""

from typing import Any

from fastapi import APIRouter, Request, Response
from pydantic import Field

from app.api.schemas.service import MeOut
from app.api.web.authentication import COOKIE, SESSION_S, User, token_of
from app.api.web.dependencies import AuthenticationPart
from app.api.web.problems import Problem
from app.api.web.request_body import Body
from app.words import Message

router = APIRouter(tags=["login"])


class Login(Body):
    """Whoever knows the engineer's password is one; the name goes into the event log."""

    name: str = Field("", max_length=40)
    password: str = Field(max_length=200)


def _me(user: User | None, *, password_required: bool) -> dict[str, Any]:
    return {
        "role": user and user.role,
        "name": user and user.name,
        "password_required": password_required,
    }


@router.get("/me", response_model=MeOut)
async def me(request: Request, authentication: AuthenticationPart) -> dict[str, Any]:
    """Role and name of whoever asks; null where nobody is logged in."""
    return _me(request.state.user, password_required=not authentication.is_open)


@router.post("/login", response_model=MeOut)
def login(body: Login, request: Request, response: Response, authentication: AuthenticationPart) -> dict[str, Any]:
    """Exchange a password for a cookie."""
    address = request.client.host if request.client else ""
    user = (
        User("engineer", "engineer")
        if authentication.is_open
        else authentication.login(body.name, body.password, address)
    )
    if user is None:
        raise Problem(401, "wrong-password", Message("wrong-password"))
    response.set_cookie(
        COOKIE,
        authentication.open_session(user),
        max_age=int(SESSION_S),
        httponly=True,
        samesite="strict",
        secure=request.url.scheme == "https",
    )
    return _me(user, password_required=not authentication.is_open)


@router.post("/logout", response_model=MeOut)
def logout(request: Request, response: Response, authentication: AuthenticationPart) -> dict[str, Any]:
    """Forget the cookie."""
    authentication.close_session(token_of(request.headers))
    response.delete_cookie(COOKIE)
    return _me(None, password_required=not authentication.is_open)
