"""Accounts of people and tokens of programs: one file in the data folder that only its owner may read.

Passwords are kept as argon2id, tokens as SHA-256 (they are random, not chosen). The file is written whole or not at
all, also by a command during a running service, which notices.
"""

import hashlib
import json
import re
import secrets
import threading
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TypeVar

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError
from filelock import FileLock

from app.api.access.roles import MOST_DAYS, Role
from app.errors import AppError, ConfigError
from app.service.settings import MOST_CHARACTERS, check_password
from app.sources.data_file import checked, parse_object, replace_file
from app.words import Message

FILE = "accounts.json"
TOKEN_PREFIX = "vw_"
MOST = 1000  # accounts, and tokens
DAY_S = 86400.0
_NAME = re.compile(r"[^\x00-\x1f\x7f:/]{1,40}")
_LOCK_S = 10.0
# OWASP's least for argon2id: 19 MiB, which a Raspberry Pi that records can spare
_HASHER = PasswordHasher(time_cost=2, memory_cost=19 * 1024, parallelism=1)
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class Account:
    """A person; `stamp` is another after every change, which ends their sessions."""

    name: str
    role: Role
    password: str  # argon2id
    stamp: str


@dataclass(frozen=True, slots=True)
class Token:
    """A program's right until a day; unix times."""

    id: str
    name: str
    role: Role
    digest: str
    made_by: str
    made_s: float
    ends_s: float


@dataclass(frozen=True, slots=True)
class _Held:
    accounts: dict[str, Account] = field(default_factory=dict)  # by folded name
    tokens: dict[str, Token] = field(default_factory=dict)  # by digest


class ChiefNeeded(AppError):
    """This is not the first chief's account; a chief has to change it."""


class Accounts:
    """The file; thread-safe."""

    def __init__(self, folder: Path) -> None:
        """Read it.

        Raises:
            ConfigError: there is one that cannot be read.
        """
        self._path = folder / FILE
        self._lock = threading.Lock()
        self._held = _Held()
        self._is_broken = False
        self._seen: tuple[int, int, int] | None = None  # the file's time, size, inode
        self._read(strict=True)

    @property
    def exist(self) -> bool:
        """Somebody has an account, or the file cannot be read: then nobody comes in without a password."""
        return bool(self._read().accounts) or self._is_broken

    @property
    def has_chief(self) -> bool:
        """Somebody may manage them."""
        return any(account.role == "chief" for account in self._read().accounts.values())

    def all(self) -> list[Account]:
        """Return the accounts by name."""
        return sorted(self._read().accounts.values(), key=lambda account: account.name)

    def tokens(self) -> list[Token]:
        """Return the tokens, newest first; ended ones, too."""
        return sorted(self._read().tokens.values(), key=lambda token: -token.made_s)

    def find(self, name: str) -> Account | None:
        """Return an account by its name, whatever its case."""
        return self._read().accounts.get(_folded(name))

    def verify(self, name: str, password: str) -> Account | None:
        """Return the account whose password this is; it takes as long where there is no such account."""
        account = self.find(name)
        try:
            _HASHER.verify(account.password if account else _nobodys(), password[:MOST_CHARACTERS])
        except (VerificationError, InvalidHashError, UnicodeEncodeError):
            return None
        return account

    def verify_token(self, secret: str, now_s: float) -> Token | None:
        """Return the token that this is, if it has not ended."""
        token = self._read().tokens.get(_digest(secret))
        return token if token is not None and now_s < token.ends_s else None

    def put(self, name: str, role: Role, password: str | None, *, is_first: bool = False) -> Account:
        """Add an account or change it; without a password it keeps the one that it has.

        Args:
            name: of the person, whatever its case.
            role: from now on.
            password: a new one.
            is_first: nobody who may manage accounts does this: only while there is no chief, and to no account.

        Raises:
            ChiefNeeded: `is_first`, and there is a chief or such an account.
            ConfigError: name or password cannot be one, or nobody would be chief.
        """
        name = name.strip()
        if not _NAME.fullmatch(name):
            raise ConfigError("name", name, Message("account-name-form"))
        if password is not None:
            check_password("password", password)
        try:
            hashed = None if password is None else _HASHER.hash(password)
        except UnicodeEncodeError as error:
            raise ConfigError("password", Message("hidden"), Message("account-name-form")) from error

        def change(held: _Held) -> Account:
            before = held.accounts.get(_folded(name))
            if is_first and (before is not None or any(account.role == "chief" for account in held.accounts.values())):
                raise ChiefNeeded(Message("chief-manages"))
            if hashed is None and before is None:
                raise ConfigError("password", Message("not-given"), Message("field-required"))
            if before is None and len(held.accounts) >= MOST:
                raise ConfigError("accounts", MOST, Message("input-at-most", limit=MOST))
            kept = hashed if hashed is not None or before is None else before.password
            held.accounts[_folded(name)] = made = Account(name, role, kept or "", secrets.token_hex(8))
            _needs_chief(held, before)
            return made

        return self._change(change)

    def remove(self, name: str) -> bool:
        """Take an account away; False where there is none.

        Raises:
            ConfigError: nobody would be chief any more.
        """

        def change(held: _Held) -> bool:
            before = held.accounts.pop(_folded(name), None)
            if held.accounts:
                _needs_chief(held, before)
            return before is not None

        return self._change(change)

    def make_token(self, name: str, role: Role, days: float, made_by: str, now_s: float) -> tuple[Token, str]:
        """Return a token and its secret, which is shown only this once.

        Raises:
            ConfigError: a value is not allowed.
        """
        if not _NAME.fullmatch(name.strip()):
            raise ConfigError("name", name, Message("account-name-form"))
        if not 0 < days <= MOST_DAYS:
            raise ConfigError("days", days, Message("input-at-most", limit=MOST_DAYS))
        secret = TOKEN_PREFIX + secrets.token_urlsafe(32)
        made = Token(secrets.token_hex(4), name.strip(), role, _digest(secret), made_by, now_s, now_s + days * DAY_S)

        def change(held: _Held) -> None:
            if len(held.tokens) >= MOST:
                raise ConfigError("tokens", MOST, Message("input-at-most", limit=MOST))
            held.tokens[made.digest] = made

        self._change(change)
        return made, secret

    def revoke_token(self, token_id: str) -> bool:
        """Take a token away; False where there is none."""

        def change(held: _Held) -> bool:
            digests = [digest for digest, token in held.tokens.items() if token.id == token_id]
            for digest in digests:
                del held.tokens[digest]
            return bool(digests)

        return self._change(change)

    def _change(self, change: Callable[[_Held], Result]) -> Result:
        with FileLock(self._path.with_suffix(".lock"), timeout=_LOCK_S):
            held = self._read(strict=True)
            changed = replace(held, accounts=dict(held.accounts), tokens=dict(held.tokens))
            result = change(changed)
            lists = {
                "accounts": [asdict(account) for account in changed.accounts.values()],
                "tokens": [asdict(token) for token in changed.tokens.values()],
            }
            replace_file(self._path, json.dumps(lists, indent=1).encode(), is_private=True)
        return result

    def _read(self, *, strict: bool = False) -> _Held:
        """What the file holds now; where it cannot be read, what it held last."""
        with self._lock:
            try:
                state = self._path.stat()
                seen = (state.st_mtime_ns, state.st_size, state.st_ino)
                if seen != self._seen:
                    self._held = _parse(self._path.read_bytes())
                    self._seen = seen
                self._is_broken = False
            except FileNotFoundError:
                self._held, self._seen, self._is_broken = _Held(), None, False
            except (OSError, ValueError, TypeError, KeyError) as error:
                self._is_broken = True
                if strict:
                    raise ConfigError("accounts", self._path, Message("accounts-unreadable")) from error
            return self._held


def _parse(content: bytes) -> _Held:
    lists = parse_object(content)
    accounts = [checked(Account(**values)) for values in lists["accounts"]]
    tokens = [checked(Token(**values)) for values in lists["tokens"]]
    return _Held({_folded(account.name): account for account in accounts}, {token.digest: token for token in tokens})


def _needs_chief(held: _Held, before: Account | None) -> None:
    """Whoever was the last chief stays one."""
    if (
        before is not None
        and before.role == "chief"
        and all(account.role != "chief" for account in held.accounts.values())
    ):
        raise ConfigError("role", before.name, Message("last-chief"))


def _folded(name: str) -> str:
    return name.strip().casefold()


def _digest(secret: str) -> str:
    return hashlib.sha256(secret.encode(errors="surrogatepass")).hexdigest()


_NOBODYS: list[str] = []


def _nobodys() -> str:
    """The hash of a password that nobody knows."""
    if not _NOBODYS:
        _NOBODYS.append(_HASHER.hash(secrets.token_hex(16)))
    return _NOBODYS[0]
