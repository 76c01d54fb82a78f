"""The signed log of a data folder in words, with every signature checked; works beside a running service."""

import json
import sys
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path

from app.configuration.history import BEGUN, CONFIG_ACTIONS, ConfigHistory, Record
from app.errors import ConfigError
from app.words import Message
from firmware_protocol.config_image import image_hash
from firmware_protocol.memory_map import CONFIG_SIZE

NOT_GENUINE = 1


def show(folder: Path, *, as_json: bool) -> int:
    """Print every record, oldest first; return 1 where one is not genuine.

    Raises:
        ConfigError: there is no log, or it cannot be read.
    """
    try:
        records = ConfigHistory(folder).records()
    except OSError as error:
        raise ConfigError("data", folder, error.strerror or str(error)) from error
    if not records:
        raise ConfigError("data", folder, Message("no-signed-log"))
    for record in records:
        print(json.dumps(_json(record)) if as_json else _line(record))
    wrong = [record.number for record in records if not record.is_genuine]
    print(
        f"{len(records)} records; "
        + (f"not genuine: {', '.join(map(str, wrong))}" if wrong else "all signatures right"),
        file=sys.stderr,
    )
    return NOT_GENUINE if wrong else 0


def _line(record: Record) -> str:
    time = datetime.fromtimestamp(record.t_wall_ns / 1e9, UTC).strftime("%Y-%m-%d %H:%M:%S")
    images = f" {_hash(record.before)} -> {_hash(record.after)}" if record.action in CONFIG_ACTIONS else ""
    reason = f" ({record.reason})" if record.reason else ""
    result = "no outcome is known" if record.result == BEGUN else record.result
    genuine = "" if record.is_genuine else "  NOT GENUINE"
    return f"{record.number} {time} {record.who}: {record.action} {record.source}{images}{reason}: {result}{genuine}"


def _json(record: Record) -> dict[str, object]:
    return asdict(record) | {"before": _hash(record.before), "after": _hash(record.after)}


def _hash(image: bytes) -> str | None:
    return image_hash(image) if len(image) == CONFIG_SIZE else None
