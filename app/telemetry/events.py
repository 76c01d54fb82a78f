"""Links, events and alarms. Frozen, SI units, no behaviour."""

from dataclasses import dataclass
from typing import Annotated, Literal

from app.telemetry.fields import LEFT_OUT, SentAs, Unit
from app.words import Message, Quantity, Text

LinkName = Literal["rs232", "can"]
LinkState = Literal["off", "connecting", "silent", "late", "live", "lost"]
BusState = Literal["active", "warning", "passive", "off"]
Severity = Literal["info", "watch", "warning", "trip"]
AlarmSeverity = Literal["watch", "warning", "trip"]


@dataclass(frozen=True, slots=True)
class LinkStatus:
    """One link's trust."""

    state: LinkState = "off"
    url: str | None = None
    age_s: Annotated[float | None, Unit("s", "since the newest good frame was sent")] = None
    frames: int = 0
    lost: int = 0  # by gaps in the sequence
    crc_errors: int | None = 0  # None: a CAN controller does not tell
    resyncs: int | None = 0  # no frame for another reason, or one with an impossible body; None: as above
    bytes: int = 0
    rate_hz: Annotated[float, Unit("Hz", "snapshots (RS232) or frames (CAN) in the last two seconds")] = 0.0
    bytes_per_s: Annotated[float, Unit("B/s", "in the last two seconds")] = 0.0
    line_load: Annotated[float | None, Unit("1", "share of the line's capacity, with the most stuffing on CAN")] = None
    reconnects: int = 0
    error: Text | None = None
    errors: int | None = None  # error frames of a CAN adapter, None where it passes none on
    tx_errors: int | None = None  # its controller's error counters
    rx_errors: int | None = None
    bus_state: BusState | None = None  # None before the first report
    unframed: Annotated[str | None, LEFT_OUT] = None  # the last bytes in hex, while bytes arrive and no frame does


@dataclass(frozen=True, slots=True)
class Links:
    """Both links."""

    rs232: LinkStatus
    can: LinkStatus

    def items(self) -> tuple[tuple[LinkName, LinkStatus], ...]:
        """Each link with its name."""
        return ("rs232", self.rs232), ("can", self.can)


@dataclass(frozen=True, slots=True)
class Disagreement:
    """One value of which the links say two things, in its unit."""

    name: str
    rs232: float
    can: float
    unit: str
    since_ns: int


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened: `code` is its kind, `message` its text."""

    time_ns: Annotated[int, SentAs("time", 1e9)]
    severity: Severity
    code: str
    message: Message
    cell: int | None = None
    value: float | None = None
    limit: float | None = None
    unit: str = ""
    who: str | None = None


@dataclass(frozen=True, slots=True)
class PossibleCause:
    """A possible cause of a trip; cell and pack count from 0."""

    code: str
    message: Message
    cell: int | None
    pack: int | None
    confidence: Annotated[float, Unit("1", "share among what it may be", 3)]


@dataclass(frozen=True, slots=True)
class TripCause(PossibleCause):
    """The cause of a trip, determined from the recording seconds after it."""

    others: tuple[PossibleCause, ...] = ()
    size: Annotated[float | None, Unit("", "how much, in `unit`; missing where it has no size", None)] = None
    low: Annotated[float | None, Unit("", "lower end of its band, in `unit`", None)] = None
    high: Annotated[float | None, Unit("", "upper end of its band, in `unit`", None)] = None
    unit: str = ""
    since: Annotated[float | None, Unit("s", "when it can first be seen, in unix time", 3)] = None
    judged: Annotated[float | None, Unit("s", "up to when the recording was looked at, in unix time", 3)] = None
    revised: bool = False  # it takes the place of an earlier one


@dataclass(frozen=True, slots=True)
class Alarm:
    """A condition that holds, or held and was not acknowledged."""

    id: int
    code: str
    severity: AlarmSeverity
    message: Message
    since_ns: Annotated[int, SentAs("since", 1e9)]
    active: bool
    cell: int | None = None
    value: Annotated[float | None, Unit("", "in `unit`")] = None
    limit: Annotated[float | None, Unit("", "in `unit`")] = None
    unit: str = ""
    acknowledged_by: str | None = None
    cells: tuple[int, ...] = ()  # every cell it is about, where they are more than `cell`
    cause: TripCause | None = None  # cause of a trip, once known
    ended_ns: Annotated[int | None, SentAs("ended", 1e9)] = None  # when it was last seen to hold


@dataclass(frozen=True, slots=True)
class Identity:
    """The master's answer to IDENT."""

    firmware: str
    protocol: int
    map_hash: str
    is_compatible: bool
    boots: int


LATE: dict[LinkName, Message] = {"rs232": Message("rs232-late"), "can": Message("can-late")}
SILENT: dict[LinkName, Message] = {"rs232": Message("rs232-silent"), "can": Message("can-silent")}
CONNECTING: dict[LinkName, Message] = {"rs232": Message("rs232-connecting"), "can": Message("can-connecting")}


def link_lost(link: LinkName, error: Text | None) -> Message:
    """The event of a link that was lost."""
    why = error or Message("link-closed")
    return Message("rs232-lost", error=why) if link == "rs232" else Message("can-lost", error=why)


def link_stuck(link: str, silent_s: float) -> Message:
    """The event of a link whose driver has blocked its thread for so long [s]."""
    time = Quantity(silent_s, "s", 0)
    return Message("rs232-stuck", time=time) if link == "rs232" else Message("can-stuck", time=time)


def link_trouble(link: LinkName, status: LinkStatus) -> Message | None:
    """Return the fault that keeps a link from being live, None where it is, or where there is none."""
    if status.state in ("off", "live"):
        return None
    if status.state == "lost":
        return link_lost(link, status.error)
    what = CONNECTING[link] if status.state == "connecting" else SILENT[link]
    return what if status.error is None else Message("of-source", source=what, reason=status.error)
