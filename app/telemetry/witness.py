"""What another source says of the same battery: its age, and how far it agrees. Frozen, SI units, no behaviour."""

from dataclasses import dataclass
from typing import Annotated, Literal

from app.telemetry.events import LinkStatus
from app.telemetry.fields import LEFT_OUT, Unit

Quantity = Literal["current", "pack_voltage", "soc", "voltage", "temperature"]


@dataclass(frozen=True, slots=True)
class WitnessReading:
    """One quantity that both tell, as means of the last 2 s; of cells the one that is furthest off."""

    quantity: Quantity
    value: Annotated[float | None, Unit("", "by the witness, in `unit`")]
    ours: Annotated[float | None, Unit("", "by the battery itself, in `unit`")]
    limit: Annotated[float | None, Unit("", "how far the two may be apart just now, in `unit`")]
    unit: str
    cell: int | None
    verdict: bool | None  # they agree; null: one of the two is missing or old


@dataclass(frozen=True, slots=True)
class Witness:
    """Another source."""

    name: str
    bus: int  # 0: that of the battery
    age_s: Annotated[float | None, Unit("s", "since its newest frame that tells anything; null: never heard")]
    readings: tuple[WitnessReading, ...]
    link: Annotated[LinkStatus | None, LEFT_OUT] = None  # of a bus of its own
