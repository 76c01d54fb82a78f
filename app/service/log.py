"""Logging: one line a happening."""

import logging


def configure(level: str) -> None:
    """Set up the root logger; called by the command line only."""
    logging.basicConfig(
        level=level.upper(), format="%(asctime)s %(levelname)-7s %(name)s: %(message)s", datefmt="%H:%M:%S"
    )
    logging.getLogger("can").setLevel(logging.WARNING)
