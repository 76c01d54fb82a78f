"""The configuration's part of the REST interface, for scripts; every refusal carries the exit code that it means."""

import base64
import json
import os
import urllib.error
import urllib.request
from typing import Any
from urllib.parse import urlencode

from app.errors import AppError
from app.sessions.transfer.trust import opener

OCTETS = "application/octet-stream"
JSON = "application/json"
REFUSED, UNREACHABLE, CONFLICT, NOT_VERIFIED = 2, 3, 4, 5
_EXIT_CODES = {412: CONFLICT, 503: UNREACHABLE, 401: UNREACHABLE, 403: UNREACHABLE, 429: UNREACHABLE}
_TIMEOUT_S = 30


class Refusal(AppError):
    """The service, or nobody, answered with an error; `exit_code` is what a script shall see."""

    def __init__(self, text: str, exit_code: int) -> None:
        self.exit_code = exit_code
        super().__init__(text)


class ConfigService:
    """Talks to `/api/v1/config` of a running service."""

    def __init__(self, url: str, *, trust: str | None = None) -> None:
        """Raises Refusal where no service can be at such a URL, ConfigError where `trust` is no certificate's."""
        if not url.startswith(("http://", "https://")):
            raise Refusal(f"url = {url}: has to be http://HOST:PORT", REFUSED)
        self._opener = opener(trust)
        self._base = url.rstrip("/") + "/api/v1/config"

    def ask(
        self,
        path: str = "",
        *,
        method: str = "GET",
        body: bytes | None = None,
        headers: dict[str, str] | None = None,
        query: dict[str, str] | None = None,
    ) -> tuple[bytes, str]:
        """Return (body, etag).

        Raises:
            Refusal: with the problem's own words, or because nobody answers.
        """
        url = self._base + path + (f"?{urlencode(query)}" if query else "")
        request = urllib.request.Request(url, data=body, method=method, headers=headers or {})
        if password := os.environ.get("VOLTWALL_PASSWORD"):
            token = base64.b64encode(
                f"{os.environ.get('VOLTWALL_NAME') or os.environ.get('USER', 'script')}:{password}".encode()
            ).decode()
            request.add_header("Authorization", f"Basic {token}")
        try:
            with self._opener.open(request, timeout=_TIMEOUT_S) as answer:
                return answer.read(), answer.headers.get("ETag", "").strip('"')
        except urllib.error.HTTPError as error:
            raise _refusal(error) from error
        except (urllib.error.URLError, ValueError, OSError) as error:
            reason = getattr(error, "reason", error)
            raise Refusal(f"url = {url}: no voltwall service answers there ({reason})", UNREACHABLE) from error

    def json(self, path: str, **options: Any) -> Any:
        """The answer's JSON."""
        return json.loads(self.ask(path, **options)[0] or b"null")

    def send(
        self, path: str, method: str, document: object, *, etag: str = "", query: dict[str, str] | None = None
    ) -> Any:
        """Send JSON and return JSON."""
        headers = {"Content-Type": JSON} | ({"If-Match": f'"{etag}"'} if etag else {})
        body = json.dumps(document).encode()
        return self.json(path, method=method, body=body, headers=headers, query=query)


def _refusal(error: urllib.error.HTTPError) -> Refusal:
    try:
        problem = json.loads(error.read())
        text, kind = str(problem["detail"]), str(problem["type"])
    except (ValueError, KeyError, TypeError):
        text, kind = str(error), ""
    if kind.endswith(":not-verified"):
        return Refusal(f"{text} (in force: {problem.get('in_force')})", NOT_VERIFIED)
    if kind.endswith(":reason-required"):
        return Refusal(f"{text}; give it with --reason", REFUSED)
    return Refusal(text, UNREACHABLE if kind.endswith(":no-reply") else _EXIT_CODES.get(error.code, REFUSED))
