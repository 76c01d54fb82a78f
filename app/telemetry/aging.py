"""Ages grow between the making of a snapshot and its sending: what waited is counted to the last moment."""

from dataclasses import fields, replace

from app.telemetry.events import LinkStatus
from app.telemetry.measurement import STALE_S
from app.telemetry.snapshot import Ages, Number, Snapshot


def is_stale(snapshot: Snapshot, part: str) -> bool:
    """A part is older than it may be to count as live, or was never received."""
    age_s: Number = getattr(snapshot.age_s, part)
    live_s: Number = None if snapshot.live_s is None else getattr(snapshot.live_s, part)
    return age_s is None or age_s >= (STALE_S if live_s is None else live_s)


def aged(snapshot: Snapshot, now_ns: int) -> Snapshot:
    """Return a snapshot with its ages at an instant of the monotonic clock.

    A replay's ages are those of then.
    """
    waited_s = (now_ns - snapshot.t_mono_ns) / 1e9
    if snapshot.source == "replay" or waited_s <= 0.0:
        return snapshot

    def older(age_s: Number) -> Number:
        return None if age_s is None else age_s + waited_s

    def link(status: LinkStatus) -> LinkStatus:
        return replace(status, age_s=older(status.age_s))

    ages = Ages(*(older(getattr(snapshot.age_s, field.name)) for field in fields(Ages)))
    links = replace(snapshot.links, rs232=link(snapshot.links.rs232), can=link(snapshot.links.can))
    cells = snapshot.cells
    if cells.voltage_age_s is not None:
        cells = replace(cells, voltage_age_s=cells.voltage_age_s + waited_s)
    return replace(snapshot, age_s=ages, links=links, cells=cells)
