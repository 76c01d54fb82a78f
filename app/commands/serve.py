"""`voltwall serve`."""

import argparse
import logging
from dataclasses import asdict
from typing import Any, Literal, get_args, get_origin

from app.errors import ConfigError, validation_text
from app.service.settings import Settings
from app.words import Message

SECRETS = (
    "password",
    "viewer_password",
    "mqtt_password",
    "recorder_password",
)  # by environment only: a command line is visible to everyone on the machine
METAVARS = {
    "serial": "URL",
    "can": "INTERFACE:CHANNEL",
    "battery": "FILE|NAME",
    "data": "DIR",
    "cell": "CELL.toml",
    "tls_cert": "FILE",
    "tls_key": "FILE",
    "trust": "FILE|FINGERPRINT,...",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """One flag a setting; what is not given comes from VOLTWALL_<NAME>, else from the default."""
    parser.set_defaults(run=run)
    for name, field in Settings.model_fields.items():
        if name in SECRETS:
            continue
        flag = "--" + name.replace("_", "-")
        default = "" if field.is_required() or field.default is None else f" (default: {_default(name)})"
        text = f"{field.description}{default}".replace("%", "%%")
        options: dict[str, Any] = {"default": None, "help": text}
        if field.annotation is bool:
            options["action"] = argparse.BooleanOptionalAction
        elif get_origin(field.annotation) is Literal:
            options["choices"] = get_args(field.annotation)
        else:
            options["metavar"] = METAVARS.get(name)
        if name == "battery":
            options["action"] = "append"  # a second one is refused, not taken in place of the first
        parser.add_argument(flag, **options)
    parser.epilog = (
        "Without --serial and --can the service starts the simulator and connects to it by a pseudo-terminal\n"
        "and a CAN adapter. Passwords: VOLTWALL_PASSWORD (engineer), VOLTWALL_VIEWER_PASSWORD (viewer)."
    )


def _default(name: str) -> str:
    return str(Settings.model_fields[name].get_default(call_default_factory=True, validated_data={}))


def settings_from(args: argparse.Namespace) -> Settings:
    """Return the settings: flag over environment over default.

    Raises:
        ConfigError: names the first setting that is wrong.
    """
    from pydantic import ValidationError

    from app.api.access.accounts import Accounts

    given: dict[str, Any] = {
        name: getattr(args, name) for name in Settings.model_fields if getattr(args, name, None) is not None
    }
    if args.battery:
        given["battery"], *more = args.battery
        if more:
            raise ConfigError("battery", ", ".join(args.battery), Message("one-battery"))
    try:
        settings = Settings(**given)
    except ValidationError as error:
        first = error.errors()[0]
        raise ConfigError(".".join(map(str, first["loc"])), first.get("input"), validation_text(first)) from error
    settings.check(has_accounts=Accounts(settings.data).exist)
    return settings


def run(args: argparse.Namespace) -> int:
    """Serve until a signal ends it."""
    from app.commands.server import AGAIN, serve_once
    from app.service import log
    from app.sources.connections import NAMES as CONNECTIONS
    from app.sources.connections import load_connections

    given = settings_from(args)
    log.configure(given.log_level)
    for weak in given.weak_passwords():
        logging.getLogger(__name__).warning("a weak password: %s", weak)
    code = AGAIN
    while code == AGAIN:
        is_fixed = bool(given.model_fields_set & {*CONNECTIONS})
        chosen = None if is_fixed else load_connections(given.data)
        settings = given if chosen is None else given.model_copy(update=asdict(chosen))
        code, port = serve_once(settings, is_fixed=is_fixed)
        # a free port that was taken stays the same; a scenario may need packs that the next battery does not have
        given = given.model_copy(update={"port": port, "scenario": None})
    return code
