"""`voltwall dbc`: the CAN tables of a configuration as a DBC file."""

import argparse
import sys
from pathlib import Path

from app.errors import ConfigError
from firmware_protocol.config_image import default_image
from firmware_protocol.dbc import to_dbc
from firmware_protocol.memory_map import CONFIG_SIZE
from firmware_protocol.older_maps import present_image


def run(args: argparse.Namespace) -> int:
    """Write it."""
    image = default_image() if args.image is None else _image(args.image)
    text = to_dbc(image)
    if args.out is None:
        sys.stdout.write(text)
    else:
        try:
            args.out.write_text(text, encoding="utf-8")
        except OSError as error:
            raise ConfigError("out", args.out, error.strerror or str(error)) from error
    return 0


def _image(path: Path) -> bytes:
    try:
        image = path.read_bytes()
    except OSError as error:
        raise ConfigError("image", path, error.strerror or str(error)) from error
    if len(image) != CONFIG_SIZE:
        raise ConfigError("image", path, f"{len(image)} bytes, a configuration has {CONFIG_SIZE}")
    return present_image(image)
