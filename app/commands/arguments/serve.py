"""`voltwall serve`."""

import argparse

from app.commands.arguments.work import Work
from app.estimation.filters.filter_names import FILTERS
from app.service.settings import Settings

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
    parser.set_defaults(do=Work("serve.run"))
    for name, field in Settings.model_fields.items():
        if name in SECRETS:
            continue
        flag = "--" + name.replace("_", "-")
        default = "" if field.is_required() or field.default is None else f" (default: {_default(name)})"
        text = f"{field.description}{default}".replace("%", "%%")
        if field.annotation is bool:
            parser.add_argument(flag, action=argparse.BooleanOptionalAction, default=None, help=text)
            continue
        choices: tuple[str, ...] | None = FILTERS if name == "filter" else None
        if name == "log_level":
            choices = ("debug", "info", "warning", "error")
        if name == "recorder_order":
            choices = ("oldest", "newest")
        metavar = METAVARS.get(name)
        if name == "battery":
            parser.add_argument(flag, action="append", default=None, help=text, metavar=metavar)
            continue
        parser.add_argument(flag, default=None, help=text, choices=choices, metavar=None if choices else metavar)
    parser.epilog = (
        "Without --serial and --can the simulated accumulator is started and read through a pseudo-terminal\n"
        "and a CAN adapter. Passwords: VOLTWALL_PASSWORD (engineer), VOLTWALL_VIEWER_PASSWORD (viewer)."
    )


def _default(name: str) -> str:
    return str(Settings.model_fields[name].get_default(call_default_factory=True, validated_data={}))
