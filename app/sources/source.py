"""The interface of a source of measurements: items of a link in, measurements and events out."""

from dataclasses import dataclass
from typing import Protocol

from app.battery.battery import Battery
from app.sources.items import Item
from app.telemetry import Event, Source
from app.telemetry.measurement import Measurement


@dataclass(frozen=True, slots=True)
class Received:
    """Results of one item."""

    measurement: Measurement | None = None
    events: tuple[Event, ...] = ()


NOTHING_RECEIVED = Received()


class MeasurementSource(Protocol):
    """Knows one protocol. Called from one thread; time comes with the items."""

    @property
    def name(self) -> Source:
        """Return the name of the source."""

    @property
    def battery(self) -> Battery:
        """Return the battery of the measurements."""

    @property
    def due_ns(self) -> int | None:
        """Return when `measure` has something new to tell without another item; None: nothing waits."""

    def feed(self, item: Item) -> Received:
        """Take one item from a link."""

    def measure(self, t_mono_ns: int, t_wall_ns: int) -> Measurement:
        """Return a measurement in which nothing is new but the ages."""
