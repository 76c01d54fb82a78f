"""The filters by name: for the command line and the settings, which need no filter yet."""

from typing import Final, Literal, get_args

FilterName = Literal["fused", "coulomb", "ekf", "ukf", "cdkf"]
FILTERS: Final[tuple[FilterName, ...]] = get_args(FilterName)
