"""Who may do what: loopback without a password is the engineer; otherwise a session cookie or HTTP Basic.

Foreign origins and foreign host names are refused before anything else looks at the request.
"""

import base64
import binascii
import hmac
import secrets
import threading
from dataclasses import dataclass
from ipaddress import ip_address, ip_network
from typing import Literal
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.requests import cookie_parser
from starlette.types import ASGIApp, Receive, Scope, Send

from app.api.web.problems import Problem
from app.clock import Clock
from app.service.settings import Settings
from app.words import Message

COOKIE = "voltwall"
SESSION_S = 24 * 3600.0
MAX_SESSIONS = 1000  # of each role: viewers cannot log the engineer out
MAX_SOURCES = 10_000  # of failed tries
MAX_FAILURES = 10  # in FAILURE_WINDOW_S, per source
FAILURE_WINDOW_S = 60.0
OPEN_PATHS = ("/api/v1/health", "/api/v1/login", "/api/v1/me")
_WRITES = ("POST", "PUT", "PATCH", "DELETE")
Role = Literal["engineer", "viewer"]
ROLES: tuple[Role, Role] = ("engineer", "viewer")


@dataclass(frozen=True, slots=True)
class User:
    """Who asks."""

    name: str
    role: Role


class Authentication:
    """Passwords, sessions and failed tries."""

    def __init__(self, settings: Settings, clock: Clock) -> None:
        self.settings = settings
        self._clock = clock
        self._sessions: dict[str, tuple[User, float]] = {}
        self._failures: dict[str, list[float]] = {}
        self._lock = threading.Lock()

    @property
    def is_open(self) -> bool:
        """No password is set: whoever reaches the service is the engineer."""
        return self.settings.password is None

    def login(self, name: str, password: str, address: str) -> User | None:
        """Return the user whose password this is, None where it is nobody's.

        Raises:
            Problem: too many failed tries from this address.
        """
        now, source = self._clock.monotonic_s(), _source_of(address)
        with self._lock:
            recent = [t for t in self._failures.get(source, []) if now - t < FAILURE_WINDOW_S]
            if len(recent) >= MAX_FAILURES:
                wait = {"Retry-After": str(int(FAILURE_WINDOW_S))}
                raise Problem(429, "too-many-tries", Message("wait-a-minute"), wait)
            for role in ROLES:
                secret = self.settings.password if role == "engineer" else self.settings.viewer_password
                if secret is not None and _is_equal(secret.get_secret_value(), password):
                    if role == "engineer":  # a viewer could else guess the engineer's for ever, logging in in between
                        self._failures.pop(source, None)
                    return User(name.strip()[:40] or role, role)
            self._failures.pop(source, None)  # to the end: the oldest leaves first
            self._failures[source] = [*recent, now]
            while len(self._failures) > MAX_SOURCES:
                self._failures.pop(next(iter(self._failures)))
        return None

    def open_session(self, user: User) -> str:
        """Return a token that stands for the user for a day."""
        now = self._clock.monotonic_s()
        token = secrets.token_urlsafe(32)
        with self._lock:
            self._sessions = {t: s for t, s in self._sessions.items() if s[1] > now}
            same_role = [t for t, (held_by, _) in self._sessions.items() if held_by.role == user.role]
            for oldest in same_role[: len(same_role) - MAX_SESSIONS + 1]:
                self._sessions.pop(oldest)
            self._sessions[token] = (user, now + SESSION_S)
        return token

    def close_session(self, token: str | None) -> None:
        """Forget a token."""
        if token:
            with self._lock:
                self._sessions.pop(token, None)

    def user_of(self, headers: Headers, address: str) -> User | None:
        """Return who asks, None where nobody known."""
        if self.is_open:
            return User("engineer", "engineer")
        token = token_of(headers)
        if token and (entry := self._sessions.get(token)) and entry[1] > self._clock.monotonic_s():
            return entry[0]
        return self._basic(headers, address)

    def _basic(self, headers: Headers, address: str) -> User | None:
        kind, _, encoded = headers.get("authorization", "").partition(" ")
        if kind.lower() != "basic":
            return None
        try:
            name, _, password = base64.b64decode(encoded, validate=True).decode().partition(":")
        except (binascii.Error, UnicodeDecodeError):
            return None
        return self.login(name, password, address)


def _is_equal(secret: str, given: str) -> bool:
    return hmac.compare_digest(secret.encode(), given.encode(errors="surrogatepass"))


def _source_of(address: str) -> str:
    """Who counts as one guesser: an IPv4 address, or an IPv6 network, of which anyone has 2^64 addresses."""
    try:
        parsed = ip_address(address)
    except ValueError:
        return address
    return address if parsed.version == 4 else str(ip_network((parsed, 64), strict=False))


def token_of(headers: Headers) -> str | None:
    """The session cookie's value."""
    return cookie_parser(headers.get("cookie", "")).get(COOKIE)


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
            user = self._admit(scope)
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
        if not is_own_host(headers.get("host", ""), loopback=authentication.settings.is_loopback):
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
        if method in _WRITES and user.role != "engineer" and path != "/api/v1/logout":
            raise Problem(403, "engineer-required", Message("viewer-may-read"))
        return user

    @staticmethod
    async def _close(receive: Receive, send: Send, code: int, reason: str) -> None:
        """Accept and close: only then does a browser see the code."""
        await receive()
        await send({"type": "websocket.accept"})
        await send({"type": "websocket.close", "code": code, "reason": reason})
