"""Every setting once: a command-line flag, an environment variable VOLTWALL_*, a default."""

import os
from importlib.resources import files
from ipaddress import ip_address
from pathlib import Path
from typing import Any, Literal

import platformdirs
from pydantic import BaseModel, ConfigDict, Field, SecretStr, model_validator

from app.battery.shape import TEAM_PROFILE
from app.errors import ConfigError
from app.estimation.filters.filter_names import FilterName
from app.words import Message

LEAST_CHARACTERS, MOST_CHARACTERS = 12, 200  # length of a password
LEAST_OF_SHARED = 8  # a service that ran with such a one goes on, with a warning
LEAST_DIFFERENT = 5  # characters: not 121212121212
COMMON_PASSWORDS = files(__package__) / "common_passwords.txt"


class Settings(BaseModel):
    """Flag over environment over default."""

    model_config = ConfigDict(frozen=True)

    serial: str | None = Field(
        default=None,
        min_length=1,
        description="RS232 of the master: a device such as /dev/ttyUSB0 or COM6, socket://host:port or rfc2217://host:port",
    )
    can: str | None = Field(
        default=None,
        min_length=1,
        description="CAN bus: INTERFACE:CHANNEL[?key=value] of python-can, such as socketcan:can0, slcan:/dev/ttyACM0",
    )
    battery: str = Field(
        default=TEAM_PROFILE,
        description="battery profile (TOML file or bundled name), or packs x series cells such as 2x6 to simulate",
    )
    host: str = Field(
        default="127.0.0.1",
        description="address to listen on; other than loopback needs a password and TLS or --plain-http",
    )
    tls_cert: Path | None = Field(default=None, description="serve HTTPS with this certificate (PEM, with its chain)")
    tls_key: Path | None = Field(default=None, description="private key of --tls-cert (PEM, unencrypted)")
    tls: bool = Field(default=False, description="serve HTTPS with a generated certificate; its fingerprint is printed")
    plain_http: bool = Field(
        default=False, description="allow unencrypted HTTP on the network: passwords can be read by others"
    )
    port: int = Field(default=8000, ge=0, le=65535, description="port to listen on, 0 for a free one")
    data: Path = Field(
        default_factory=lambda: Path(platformdirs.user_data_dir("voltwall", appauthor=False)),
        description="folder for sessions, the event log and the simulated EEPROM",
    )
    filter: FilterName = Field(default="fused", description="state estimator")
    cell: str | None = Field(default=None, description="cell file (TOML) or bundled cell; else that of the battery")
    record: bool = Field(default=True, description="record automatically while the master is connected")
    event: str | None = Field(
        default=None, description="session name prefix, such as 'FSG endurance'; else the one set on the page"
    )
    split_mb: int | None = Field(default=None, ge=1, description="start a new file after this many MB")
    keep_days: float | None = Field(
        default=None, gt=0, description="delete sessions older than this many days; else never"
    )
    keep_gb: float | None = Field(
        default=None, gt=0, description="delete the oldest sessions beyond this many GB; else never"
    )
    season: bool = Field(default=True, description="update the season data when a session closes")
    lake: str | None = Field(
        default=None, description="season data: folder or fsspec URL; else `lake` in the data folder"
    )
    mqtt: str | None = Field(
        default=None, description="MQTT broker to publish to: mqtt[s]://[USER@]HOST[:PORT][/PREFIX]"
    )
    car: str | None = Field(default=None, description="name of this car at the broker: its topics are PREFIX/CAR/...")
    url: str | None = Field(
        default=None,
        pattern=r"^https?://[^\s/]+",
        description="public URL of this service for the fleet page; else the address of this machine",
    )
    fleet: str | None = Field(
        default=None,
        description="show all cars of this MQTT broker instead of one car: mqtt[s]://[USER@]HOST[:PORT][/PREFIX]",
    )
    mqtt_ca: Path | None = Field(
        default=None, description="certificate authority of an mqtts broker, if unknown to the system"
    )
    mqtt_password: SecretStr | None = Field(default=None, description="password of the MQTT user")
    recorder: str | None = Field(
        default=None,
        description="recorders whose sessions are copied continuously: [LABEL=]URL,...",
    )
    recorder_order: Literal["oldest", "newest"] = Field(
        default="oldest", description="which missing data is copied first"
    )
    trust: str | None = Field(
        default=None,
        description="certificates of other services to trust: PEM file, or SHA-256 fingerprints separated by commas",
    )
    recorder_password: SecretStr | None = Field(default=None, description="viewer password of the recorders")
    password: SecretStr | None = Field(default=None, description="engineer password: read, write and send commands")
    viewer_password: SecretStr | None = Field(default=None, description="viewer password: read only")
    idle_minutes: float = Field(
        default=60.0,
        gt=0,
        le=1440,
        description="log out users after this many idle minutes, and after a day in any case",
    )
    scenario: str | None = Field(default=None, description="scenario of the simulator, if no hardware is given")
    balance_open: bool = Field(
        default=True, description="allow balancing with open contactors (forbidden by some competitions)"
    )
    bench: bool = Field(default=False, description="the CAN bus is a test bench, not a car: allow manual sending")
    seed: int | None = Field(
        default=None, ge=0, le=2**32 - 1, description="random seed of the simulator, 0 to 4294967295"
    )
    log_level: Literal["debug", "info", "warning", "error"] = Field(
        default="info", description="minimum level of log messages"
    )

    @model_validator(mode="before")
    @classmethod
    def _with_environment(cls, given: dict[str, Any]) -> dict[str, Any]:
        """What is not given comes from VOLTWALL_<NAME>, if that is not empty."""
        variables = {name: os.environ.get(f"VOLTWALL_{name.upper()}") for name in cls.model_fields}
        return {name: value for name, value in variables.items() if value} | given

    @property
    def simulates(self) -> bool:
        """No hardware is named: the simulated accumulator is started."""
        return self.serial is None and self.can is None

    @property
    def mqtt_secret(self) -> str | None:
        """The password of the MQTT user."""
        return None if self.mqtt_password is None else self.mqtt_password.get_secret_value()

    @property
    def recorder_secret(self) -> str | None:
        """The password of the recorders."""
        return None if self.recorder_password is None else self.recorder_password.get_secret_value()

    @property
    def split_bytes(self) -> int | None:
        """Size at which the recorder begins another session, or None."""
        return None if self.split_mb is None else self.split_mb * 1_000_000

    @property
    def is_loopback(self) -> bool:
        """Only this machine can reach the service."""
        if self.host == "localhost":
            return True
        try:
            return ip_address(self.host).is_loopback
        except ValueError:
            return False

    @property
    def has_tls(self) -> bool:
        """It serves HTTPS."""
        return self.tls or self.tls_cert is not None

    def check(self, *, has_accounts: bool = False) -> None:
        """Refuse what would be unsafe or cannot work; `has_accounts`: somebody has a password of their own.

        Raises:
            ConfigError: names the setting and what it has to be.
        """
        if not self.is_loopback and self.password is None and not has_accounts:
            raise ConfigError("host", self.host, Message("password-beyond-loopback"))
        if (self.tls_cert is None) != (self.tls_key is None):
            missing = "tls_cert" if self.tls_cert is None else "tls_key"
            raise ConfigError(missing, Message("not-given"), Message("certificate-and-key"))
        if self.tls + self.plain_http + (self.tls_cert is not None) > 1:
            raise ConfigError("tls", Message("several-given"), Message("one-of-tls"))
        if not (self.is_loopback or self.has_tls or self.plain_http):
            raise ConfigError("host", self.host, Message("tls-beyond-loopback"))
        for name in ("password", "viewer_password"):
            secret = getattr(self, name)
            if secret is not None and not LEAST_OF_SHARED <= len(secret.get_secret_value()) <= MOST_CHARACTERS:
                raise ConfigError(name, Message("hidden"), Message("characters-at-least", count=LEAST_OF_SHARED))
        if self.viewer_password is not None and self.password is None:
            raise ConfigError("viewer_password", Message("hidden"), Message("password-too"))
        if self.viewer_password is not None and self.viewer_password == self.password:
            raise ConfigError("viewer_password", Message("hidden"), Message("other-than-password"))

    def weak_passwords(self) -> list[str]:
        """Return the shared passwords that would be refused to a person, by setting: each a reason."""
        weak = []
        for name in ("password", "viewer_password"):
            secret = getattr(self, name)
            try:
                if secret is not None:
                    check_password(name, secret.get_secret_value())
            except ConfigError as error:
                weak.append(str(error))
        return weak


def check_password(field: str, password: str) -> None:
    """Refuse what is guessed first: short ones, the commonest, the same few characters.

    Raises:
        ConfigError: names the field, never the password.
    """
    if not LEAST_CHARACTERS <= len(password) <= MOST_CHARACTERS:
        raise ConfigError(field, Message("hidden"), Message("characters-at-least", count=LEAST_CHARACTERS))
    common = COMMON_PASSWORDS.read_text(encoding="utf-8").splitlines()
    if len({*password}) < LEAST_DIFFERENT or password.strip().casefold() in common:
        raise ConfigError(field, Message("hidden"), Message("no-common-password"))
