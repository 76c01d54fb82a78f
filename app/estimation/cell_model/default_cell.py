"""The bundled cell that is meant where none is named."""

from typing import Final

DEFAULT_CELL: Final = "samsung-25r-10p"
