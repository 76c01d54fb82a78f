"""What routes are given: the runtime, the user. Named once here."""

from typing import Annotated, cast

from fastapi import Depends
from starlette.requests import HTTPConnection

from app.api.web.authentication import Authentication, User
from app.service.runtime import Runtime


def _runtime(connection: HTTPConnection) -> Runtime:
    return cast(Runtime, connection.app.state.runtime)


def _authentication(connection: HTTPConnection) -> Authentication:
    return cast(Authentication, connection.app.state.authentication)


def _user(connection: HTTPConnection) -> User:
    """The gate let nobody through without one, but for the open paths."""
    return cast(User, connection.state.user)


RuntimeDep = Annotated[Runtime, Depends(_runtime)]
AuthenticationPart = Annotated[Authentication, Depends(_authentication)]
UserDep = Annotated[User, Depends(_user)]
