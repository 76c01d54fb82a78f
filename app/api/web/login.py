"""Routes to sign in and out, and of the signed-in user."""

from typing import Any

from fastapi import APIRouter, Request, Response
from pydantic import Field

from app.api.schemas.service import MeOut
from app.api.web.authentication import SESSION_S, Authentication, User
from app.api.web.dependencies import AuthenticationPart
from app.api.web.problems import Problem
from app.api.web.request_body import Body
from app.words import Message

router = APIRouter(tags=["login"])


class LoginIn(Body):
    """A person's own password, or the shared one of a role under any name that is no person's; both go into the log."""

    name: str = Field("", max_length=40)
    password: str = Field(max_length=200)


def _me(user: User | None, authentication: Authentication) -> dict[str, Any]:
    return {
        "role": user and user.role,
        "name": user and user.name,
        "password_required": not authentication.is_open,
        "has_chief": authentication.accounts.has_chief,
    }


@router.get("/me", response_model=MeOut)
async def me(request: Request, authentication: AuthenticationPart) -> dict[str, Any]:
    """Role and name of whoever asks; null where nobody is logged in."""
    return _me(request.state.user, authentication)


@router.post("/login", response_model=MeOut)
def login(body: LoginIn, request: Request, response: Response, authentication: AuthenticationPart) -> dict[str, Any]:
    """Exchange a password for a cookie."""
    address = request.client.host if request.client else ""
    user = (
        User("engineer", "engineer")
        if authentication.is_open
        else authentication.login(body.name, body.password, address)
    )
    if user is None:
        raise Problem(401, "wrong-password", Message("wrong-password"))
    authentication.close_session(authentication.token_of(request.headers))
    if not authentication.is_open:
        authentication.log.came_in(user.name, user.role, address)
    response.set_cookie(
        authentication.cookie_name(request.headers),
        authentication.open_session(user, address, request.headers.get("user-agent", "")),
        max_age=int(SESSION_S),
        httponly=True,
        samesite="strict",
        secure=request.scope["scheme"] == "https",
    )
    return _me(user, authentication)


@router.post("/logout", response_model=MeOut)
def logout(request: Request, response: Response, authentication: AuthenticationPart) -> dict[str, Any]:
    """Forget the cookie."""
    authentication.close_session(authentication.token_of(request.headers))
    response.delete_cookie(authentication.cookie_name(request.headers), secure=request.scope["scheme"] == "https")
    return _me(None, authentication)
