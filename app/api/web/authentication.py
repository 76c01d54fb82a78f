"""Authentication: loopback without a password is the engineer; else a session cookie, HTTP Basic or a token.

Foreign origins and foreign host names are refused before anything else looks at the request.
"""

import asyncio
import base64
import binascii
import hashlib
import hmac
import secrets
import threading
from collections.abc import Callable
from dataclasses import dataclass
from ipaddress import ip_address
from typing import cast
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.requests import cookie_parser
from starlette.types import ASGIApp, Receive, Scope, Send

from app.api.access.accounts import TOKEN_PREFIX, Accounts
from app.api.access.login_attempts import LoginAttempts
from app.api.access.login_log import LoginLog, log_without_car
from app.api.access.roles import Role
from app.api.web.problems import Problem
from app.clock import Clock
from app.service.settings import Settings
from app.words import Message

SESSION_S = 24 * 3600.0
MAX_SESSIONS = 1000  # sessions of each role: viewers cannot log the engineer out
MAX_PROVEN = 1000  # passwords of HTTP Basic that need not be checked again
OPEN_PATHS = ("/api/v1/health", "/api/v1/login", "/api/v1/me")
_OF_EVERYBODY = ("/api/v1/logout", "/api/v1/logins/", "/api/v1/me/password")  # a viewer may write this, too
_WRITES = ("POST", "PUT", "PATCH", "DELETE")


@dataclass(frozen=True, slots=True)
class User:
    """The user of a request; `token_id` where a program asks with a token."""

    name: str
    role: Role
    token_id: str | None = None


@dataclass(slots=True)
class Login:
    """Somebody who is logged in by cookie; seconds of the monotonic and of the wall clock."""

    id: str
    user: User
    stamp: str | None  # the account's stamp
    address: str
    agent: str
    since_s: float
    used_s: float
    ends_s: float


class Authentication:
    """Passwords, sessions and failed tries."""

    def __init__(
        self, settings: Settings, clock: Clock, accounts: Accounts | None = None, log: LoginLog | None = None
    ) -> None:
        self.settings = settings
        self.log = log or log_without_car(settings, clock)
        self.accounts = accounts or Accounts(settings.data)
        self._clock = clock
        self._logins: dict[str, Login] = {}  # by the digest of the token
        self._guesses = LoginAttempts(clock)
        self._proven: dict[bytes, tuple[User, str | None]] = {}  # by name and password; with the account's stamp
        self._proof_key = secrets.token_bytes(32)
        self._lock = threading.Lock()
        self.network_port: Callable[[], int | None] = lambda: None  # that phones reach by HTTPS, where one is open
        self._one_by_one = threading.Semaphore(2)  # each check of a password takes 19 MiB

    @property
    def is_open(self) -> bool:
        """No password is set: whoever reaches the service is the engineer."""
        return self.settings.password is None and not self.accounts.exist

    def login(self, name: str, password: str, address: str) -> User | None:
        """Return the user whose password, or token, this is, None where it is nobody's.

        Raises:
            Problem: too many failed tries from this address.
        """
        person = self.accounts.find(name)
        account = "" if person is None else person.name.casefold()
        if wait_s := self._guesses.begin(account, address):
            self.log.refused(None if person is None else person.name, address)
            raise Problem(429, "too-many-tries", Message("wait-a-minute"), {"Retry-After": str(int(wait_s))})
        user = self._user_by(name, password)
        if user is None:
            self._guesses.failed(account)
            self.log.refused(None if person is None else person.name, address)
        else:  # a viewer could else guess the engineer's for ever, logging in in between
            self._guesses.right(account, address, forgets=user.role != "viewer")
        return user

    def _user_by(self, name: str, password: str) -> User | None:
        if password.startswith(TOKEN_PREFIX):
            token = self.accounts.verify_token(password, self._clock.wall_s())
            return None if token is None else User(f"{token.name} (token)", token.role, token.id)
        if self.accounts.exist:
            with self._one_by_one:
                account = self.accounts.verify(name, password)
            if account is not None:
                return User(account.name, account.role)
            if self.accounts.find(name) is not None:  # nobody else logs in under a person's name
                return None
        for role, secret in (("engineer", self.settings.password), ("viewer", self.settings.viewer_password)):
            if secret is not None and _is_equal(secret.get_secret_value(), password):
                return User(name.strip()[:40] or role, cast(Role, role))
        return None

    def open_session(self, user: User, address: str = "", agent: str = "") -> str:
        """Return a token that stands for the user, for a day or until it is idle."""
        now = self._clock.monotonic_s()
        token = secrets.token_urlsafe(32)
        made = Login(
            secrets.token_hex(4),
            user,
            self._stamp(user.name),
            address,
            agent[:120],
            self._clock.wall_s(),
            now,
            now + SESSION_S,
        )
        with self._lock:
            self._logins = {t: login for t, login in self._logins.items() if self._is_good(login, now)}
            same_role = [t for t, login in self._logins.items() if login.user.role == user.role]
            for oldest in same_role[: len(same_role) - MAX_SESSIONS + 1]:
                self._logins.pop(oldest)
            self._logins[_digest(token)] = made
        return token

    def close_session(self, token: str | None) -> None:
        """Forget a token."""
        if token:
            with self._lock:
                self._logins.pop(_digest(token), None)

    def wall_s(self) -> float:
        """Unix time."""
        return self._clock.wall_s()

    def logins(self) -> list[tuple[Login, float]]:
        """Return who is logged in by cookie, and how long ago each was last used [s]."""
        now = self._clock.monotonic_s()
        with self._lock:
            return [(login, now - login.used_s) for login in self._logins.values() if self._is_good(login, now)]

    def login_of(self, token: str | None) -> Login | None:
        """Return the login that a cookie stands for."""
        login = self._logins.get(_digest(token)) if token else None
        return login if login is not None and self._is_good(login, self._clock.monotonic_s()) else None

    def end_login(self, login_id: str) -> None:
        """Log somebody out."""
        with self._lock:
            self._logins = {token: login for token, login in self._logins.items() if login.id != login_id}

    def _is_good(self, login: Login, now_s: float) -> bool:
        token_id, wall_s = login.user.token_id, self._clock.wall_s()
        if token_id and not any(token.id == token_id and wall_s < token.ends_s for token in self.accounts.tokens()):
            return False
        is_theirs = login.stamp == self._stamp(login.user.name)
        return is_theirs and now_s < login.ends_s and now_s - login.used_s < self.settings.idle_minutes * 60.0

    def cookie_name(self, headers: Headers) -> str:
        """The name of the session's cookie: browsers send it to every port of a host, and each has its own service.

        Over HTTPS it begins with `__Host-`: no other host of a domain, and no page by plain HTTP, can set such a one.
        """
        port = headers.get("host", "").rpartition("]")[2].rpartition(":")[2]
        name = f"voltwall-{port}" if port.isdigit() else "voltwall"
        is_network = port.isdigit() and int(port) == self.network_port()
        return f"__Host-{name}" if self.settings.has_tls or is_network else name

    def token_of(self, headers: Headers) -> str | None:
        """The session cookie's value."""
        return cookie_parser(headers.get("cookie", "")).get(self.cookie_name(headers))

    def user_of(self, headers: Headers, address: str) -> User | None:
        """Return who asks, None where nobody known."""
        if self.is_open:
            return User("engineer", "engineer")
        if (login := self.login_of(self.token_of(headers))) is not None:
            login.used_s = self._clock.monotonic_s()
            return login.user
        kind, _, secret = headers.get("authorization", "").partition(" ")
        if kind.lower() == "bearer":
            return self.login("", secret.strip(), address) if secret.strip().startswith(TOKEN_PREFIX) else None
        given = _basic(headers)
        if given is None:
            return None
        return self._proven_user(*given) or self._prove(*given, address)

    def _proven_user(self, name: str, password: str) -> User | None:
        """Whose password was found right before, by HTTP Basic, and is still."""
        user, stamp = self._proven.get(self._proof(name, password), (None, None))
        return user if stamp == self._stamp(name) else None

    def _prove(self, name: str, password: str, address: str) -> User | None:
        stamp = self._stamp(name)
        user = self.login(name, password, address)
        if user is None or user.token_id is not None:  # a token may be revoked, and has no account's role
            return user
        self.log.came_in(user.name, user.role, address)
        with self._lock:
            self._proven[self._proof(name, password)] = user, stamp
            while len(self._proven) > MAX_PROVEN:
                self._proven.pop(next(iter(self._proven)))
        return user

    def _stamp(self, name: str) -> str | None:
        """Of the account with this name; another where its password or role is another."""
        account = self.accounts.find(name)
        return None if account is None else account.stamp

    def is_slow(self, headers: Headers) -> bool:
        """Return whether authentication takes a moment: a password has to be checked, or a refusal to be kept."""
        given = _basic(headers)
        if given is None:
            kind, _, secret = headers.get("authorization", "").partition(" ")
            return kind.lower() == "bearer" and self.accounts.verify_token(secret.strip(), self.wall_s()) is None
        return self._proven_user(*given) is None

    def _proof(self, name: str, password: str) -> bytes:
        text = f"{name}\0{password}".encode(errors="surrogatepass")
        return hmac.digest(self._proof_key, text, "sha256")


def _basic(headers: Headers) -> tuple[str, str] | None:
    """Name and password of HTTP Basic."""
    kind, _, encoded = headers.get("authorization", "").partition(" ")
    if kind.lower() != "basic":
        return None
    try:
        name, _, password = base64.b64decode(encoded, validate=True).decode().partition(":")
    except (binascii.Error, UnicodeDecodeError):
        return None
    return name, password


def _digest(token: str) -> str:
    return hashlib.sha256(token.encode(errors="surrogatepass")).hexdigest()


def _is_equal(secret: str, given: str) -> bool:
    return hmac.compare_digest(secret.encode(), given.encode(errors="surrogatepass"))


def is_same_origin(headers: Headers) -> bool:
    """True without an Origin (no browser, or a plain navigation) and where it is this very host."""
    origin = headers.get("origin")
    if origin is None:
        return headers.get("sec-fetch-site", "none") in ("none", "same-origin")
    try:
        return origin != "null" and urlsplit(origin).netloc == headers.get("host", "")
    except ValueError:  # no URL at all
        return False


def is_own_host(host_header: str, *, loopback: bool) -> bool:
    """True where the name in Host can be this service: on loopback only loopback's own names (DNS rebinding)."""
    if not loopback:
        return True
    try:
        name = urlsplit(f"//{host_header}").hostname or ""
        return name == "localhost" or ip_address(name).is_loopback
    except ValueError:
        return False


class AuthenticationMiddleware:
    """ASGI middleware: origin, host, role. Puts the user into scope["state"]."""

    def __init__(self, app: ASGIApp, authentication: Authentication) -> None:
        self._app = app
        self._authentication = authentication

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let the request through, or answer it."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        try:
            is_slow = self._authentication.is_slow(Headers(scope=scope))
            user = await asyncio.to_thread(self._admit, scope) if is_slow else self._admit(scope)
        except Problem as problem:
            if scope["type"] == "http":
                await problem.response()(scope, receive, send)
            else:
                await self._close(receive, send, 4000 + problem.status, str(problem))
            return
        scope.setdefault("state", {})["user"] = user
        await self._app(scope, receive, send)

    def _admit(self, scope: Scope) -> User | None:
        headers = Headers(scope=scope)
        authentication = self._authentication
        is_network = (scope.get("server") or ("", None))[1] == (authentication.network_port() or -1)
        if is_network and authentication.is_open:  # the accounts were removed: no stranger is the engineer
            raise Problem(403, "login-required", Message("phones-need-password"))
        is_loopback = authentication.settings.is_loopback and not is_network
        if not is_own_host(headers.get("host", ""), loopback=is_loopback):
            raise Problem(403, "foreign-host", Message("foreign-host", host=headers.get("host")))
        path, method = scope["path"], scope.get("method", "GET")
        guarded = path.startswith("/api/") or path == "/metrics"
        if (guarded or scope["type"] == "websocket") and not is_same_origin(headers):
            whose = headers.get("origin") or Message("another-site")
            raise Problem(403, "foreign-origin", Message("foreign-origin", origin=whose))
        user = authentication.user_of(headers, scope["client"][0] if scope.get("client") else "")
        if not guarded or path in OPEN_PATHS:
            return user
        if user is None:
            # To a browser no challenge: it would put its own dialog over the page's.
            challenge = {} if "sec-fetch-mode" in headers else {"WWW-Authenticate": 'Basic realm="voltwall"'}
            raise Problem(401, "login-required", Message("log-in"), challenge)
        if method in _WRITES and user.role == "viewer" and not path.startswith(_OF_EVERYBODY):
            raise Problem(403, "engineer-required", Message("viewer-may-read"))
        return user

    @staticmethod
    async def _close(receive: Receive, send: Send, code: int, reason: str) -> None:
        """Accept and close: only then does a browser see the code."""
        await receive()
        await send({"type": "websocket.accept"})
        await send({"type": "websocket.close", "code": code, "reason": reason})
