"""Accounts, tokens, and who is logged in. A chief manages them; whoever sets the service up makes the first one."""

from typing import Annotated, Literal

from fastapi import APIRouter, Path, Request
from pydantic import BaseModel, Field

from app.api.access.accounts import ChiefNeeded
from app.api.access.roles import MOST_DAYS, Role
from app.api.web.authentication import Authentication, User
from app.api.web.dependencies import AuthenticationPart, UserDep
from app.api.web.problems import Problem, not_found
from app.api.web.request_body import Body
from app.service.settings import LEAST_CHARACTERS, MOST_CHARACTERS
from app.words import Message

router = APIRouter(tags=["login"])
Name = Annotated[str, Path(max_length=40)]
Password = Annotated[str, Field(min_length=LEAST_CHARACTERS, max_length=MOST_CHARACTERS)]


class AccountIn(Body):
    """Fields of a new account, or of a change; without a password it stays as it is."""

    role: Role
    password: Password | None = None


class PasswordIn(Body):
    """One's own password, and the new one."""

    old: str = Field(max_length=MOST_CHARACTERS)
    new: Password


class TokenIn(Body):
    """Name, role and lifetime of a new token."""

    name: str = Field(min_length=1, max_length=40)
    role: Literal["viewer", "engineer"]
    days: float = Field(gt=0, le=MOST_DAYS)


class AccountOut(BaseModel):
    """A person."""

    name: str
    role: Role


class TokenOut(BaseModel):
    """A program; unix times. `secret` is shown once, when it is made."""

    id: str
    name: str
    role: Role
    made_by: str
    made: float
    ends: float
    secret: str | None = None


class PeopleOut(BaseModel):
    """All accounts and tokens."""

    accounts: list[AccountOut]
    tokens: list[TokenOut]


class LoginOut(BaseModel):
    """Somebody who is logged in by cookie; `since` in unix seconds."""

    id: str
    name: str
    role: Role
    address: str
    agent: str
    since: float
    idle_s: float
    is_this: bool


def _need_chief(user: User) -> None:
    if user.role != "chief":
        raise Problem(403, "chief-required", Message("chief-manages"))


def _people(authentication: Authentication) -> PeopleOut:
    accounts = authentication.accounts
    tokens = [
        TokenOut(id=t.id, name=t.name, role=t.role, made_by=t.made_by, made=t.made_s, ends=t.ends_s)
        for t in accounts.tokens()
    ]
    return PeopleOut(
        accounts=[AccountOut(name=account.name, role=account.role) for account in accounts.all()], tokens=tokens
    )


@router.get("/accounts")
def people(authentication: AuthenticationPart, user: UserDep) -> PeopleOut:
    """Accounts of people and tokens of programs, for a chief."""
    _need_chief(user)
    return _people(authentication)


@router.put("/accounts/{name}")
def put_account(name: Name, body: AccountIn, authentication: AuthenticationPart, user: UserDep) -> PeopleOut:
    """Add an account, or change its role or password, which logs that person out.

    An engineer may make the first chief; a program may not.
    """
    is_person = user.role == "engineer" and user.token_id is None
    is_first = body.role == "chief" and is_person and not authentication.accounts.has_chief
    if not is_first:
        _need_chief(user)
    accounts = authentication.accounts
    password = "" if body.password is None else ", new password"
    with authentication.log.changed(user.name, f"account {name.strip()}: {body.role}{password}"):
        try:
            accounts.put(name, body.role, body.password, is_first=is_first)
        except ChiefNeeded as error:  # another became the first meanwhile
            raise Problem(403, "chief-required", error.message) from error
    authentication.log.account_changed(user.name, name.strip())
    return _people(authentication)


@router.delete("/accounts/{name}")
def delete_account(name: Name, authentication: AuthenticationPart, user: UserDep) -> PeopleOut:
    """Take an account away, and log that person out."""
    _need_chief(user)
    with authentication.log.changed(user.name, f"account {name}: removed"):
        if not authentication.accounts.remove(name):
            raise not_found("account", name)
    authentication.log.account_changed(user.name, name)
    return _people(authentication)


@router.put("/me/password", status_code=204)
def put_password(body: PasswordIn, request: Request, authentication: AuthenticationPart, user: UserDep) -> None:
    """Change one's own password; it logs one out everywhere."""
    account = authentication.accounts.find(user.name)
    address = request.client.host if request.client else ""
    if account is None or authentication.login(user.name, body.old, address) is None:
        raise Problem(403, "wrong-password", Message("wrong-password"))
    with authentication.log.changed(user.name, f"account {account.name}: new password"):
        authentication.accounts.put(account.name, account.role, body.new)
    authentication.log.account_changed(user.name, account.name)


@router.post("/tokens")
def make_token(body: TokenIn, authentication: AuthenticationPart, user: UserDep) -> TokenOut:
    """Make a token for a program; its `secret` is in this answer alone."""
    _need_chief(user)
    now_s = authentication.wall_s()
    with authentication.log.changed(user.name, f"token {body.name}: {body.role}, {body.days:g} days"):
        made, secret = authentication.accounts.make_token(body.name, body.role, body.days, user.name, now_s)
    return TokenOut(
        id=made.id,
        name=made.name,
        role=made.role,
        made_by=made.made_by,
        made=made.made_s,
        ends=made.ends_s,
        secret=secret,
    )


@router.delete("/tokens/{token_id}")
def revoke_token(token_id: Name, authentication: AuthenticationPart, user: UserDep) -> PeopleOut:
    """Take a token away."""
    _need_chief(user)
    token = next((token.name for token in authentication.accounts.tokens() if token.id == token_id), "")
    with authentication.log.changed(user.name, f"token {token} ({token_id}): revoked"):
        if not authentication.accounts.revoke_token(token_id):
            raise not_found("token", token_id)
    return _people(authentication)


@router.get("/logins")
def logins(request: Request, authentication: AuthenticationPart, user: UserDep) -> list[LoginOut]:
    """Return the sessions that are signed in by cookie: one's own; an administrator sees all."""
    this = authentication.login_of(authentication.token_of(request.headers))
    return [
        LoginOut(
            id=login.id,
            name=login.user.name,
            role=login.user.role,
            address=login.address,
            agent=login.agent,
            since=login.since_s,
            idle_s=round(idle_s, 1),
            is_this=this is not None and login.id == this.id,
        )
        for login, idle_s in authentication.logins()
        if user.role == "chief" or login.user == user
    ]


@router.delete("/logins/{login_id}", status_code=204)
def end_login(login_id: Name, authentication: AuthenticationPart, user: UserDep) -> None:
    """Log out: oneself elsewhere; a chief whomever."""
    matches = [login for login, _ in authentication.logins() if login.id == login_id]
    if not matches or not (user.role == "chief" or matches[0].user == user):
        raise not_found("login", login_id)
    with authentication.log.changed(user.name, f"login of {matches[0].user.name}: ended"):
        authentication.end_login(login_id)
