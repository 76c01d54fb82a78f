"""`voltwall firmware`: a cell file as a C header, for the estimator on the master's microcontroller."""

import argparse
import sys

from app.errors import ConfigError
from app.estimation.cell_model.cell_file import load_cell
from app.estimation.errors import EstimatorError
from app.estimation.filters.c_tables import c_tables


def run(args: argparse.Namespace) -> int:
    """Write it.

    Raises:
        ConfigError: there is no such cell, or the file cannot be written.
    """
    try:
        text = c_tables(load_cell(args.cell), args.soc_step)
    except EstimatorError as error:
        raise ConfigError("cell", args.cell, str(error)) from error
    if args.out is None:
        sys.stdout.write(text)
        return 0
    try:
        args.out.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError("out", args.out, error.strerror or str(error)) from error
    return 0
