"""Voltwall from Python: recorded sessions, seasons and the live battery, as tables.

    import voltwall

    with voltwall.open("20260714T103000Z.sqlite") as session:
        table = session.to_pandas("v", "estimate.soc")
        for lap in session.laps:
            print(lap.number, lap.duration_s, lap.energy_out_wh)

    season = voltwall.season("~/voltwall-data")
    print(season.sql("SELECT session, min(voltage_min_v) FROM cells GROUP BY session").to_pandas())

    with voltwall.connect("http://127.0.0.1:8000") as live:
        for snapshot in live:
            print(snapshot["cells"]["voltage_v"])

Units are SI with degrees Celsius, as the names of columns and attributes say; a current is positive on discharge, a
cell's index counts from 0, and what was not measured is null, never 0. Errors that the caller can fix are
`VoltwallError`. The names of `__all__`, and their attributes, are stable.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from app import __version__
from app.errors import AppError as VoltwallError

if TYPE_CHECKING:
    from voltwall.live import Live, connect
    from voltwall.records import Event, Finding, Lap
    from voltwall.seasons import Season, season
    from voltwall.sessions import Estimate, Session, open
    from voltwall.tables import Table

__all__ = [
    "Estimate",
    "Event",
    "Finding",
    "Lap",
    "Live",
    "Season",
    "Session",
    "Table",
    "VoltwallError",
    "__version__",
    "connect",
    "open",
    "season",
]

_MODULES = {
    "Estimate": "sessions",
    "Event": "records",
    "Finding": "records",
    "Lap": "records",
    "Live": "live",
    "Season": "seasons",
    "Session": "sessions",
    "Table": "tables",
    "connect": "live",
    "open": "sessions",
    "season": "seasons",
}  # imported when first asked for: the program `voltwall`, which lies in this package in a wheel, needs none of them


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
    return value


def __dir__() -> list[str]:
    return [*__all__]
