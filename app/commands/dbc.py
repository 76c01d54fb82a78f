"""`voltwall dbc`: the CAN tables of a configuration as a DBC file."""

import argparse
from pathlib import Path

from app.commands.arguments import write_out
from app.errors import ConfigError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments: source and output."""
    parser.set_defaults(run=run)
    parser.add_argument(
        "--image", type=Path, metavar="FILE", help="420-byte configuration image (default: the default tables)"
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="file to write (default: standard output)")


def run(args: argparse.Namespace) -> int:
    """Write it."""
    from firmware_protocol.config_image import default_image
    from firmware_protocol.dbc import to_dbc

    write_out(to_dbc(default_image() if args.image is None else _image(args.image)), args.out)
    return 0


def _image(path: Path) -> bytes:
    from firmware_protocol.memory_map import CONFIG_SIZE
    from firmware_protocol.older_maps import present_image

    try:
        image = path.read_bytes()
    except OSError as error:
        raise ConfigError("image", path, error.strerror or str(error)) from error
    if len(image) != CONFIG_SIZE:
        raise ConfigError("image", path, f"{len(image)} bytes, a configuration has {CONFIG_SIZE}")
    return present_image(image)
