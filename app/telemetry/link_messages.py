"""What is told of a link that is not live."""

from app.telemetry.events import LinkName, LinkStatus
from app.words import Message, Quantity, Text

LATE: dict[LinkName, Message] = {"rs232": Message("rs232-late"), "can": Message("can-late")}
SILENT: dict[LinkName, Message] = {"rs232": Message("rs232-silent"), "can": Message("can-silent")}
CONNECTING: dict[LinkName, Message] = {"rs232": Message("rs232-connecting"), "can": Message("can-connecting")}


def link_lost(link: LinkName, error: Text | None) -> Message:
    """What is told of a link that was lost."""
    why = error or Message("link-closed")
    return Message("rs232-lost", error=why) if link == "rs232" else Message("can-lost", error=why)


def link_stuck(link: str, silent_s: float) -> Message:
    """What is told of a link whose thread its driver has not given back for so long [s]."""
    time = Quantity(silent_s, "s", 0)
    return Message("rs232-stuck", time=time) if link == "rs232" else Message("can-stuck", time=time)


def link_trouble(link: LinkName, status: LinkStatus) -> Message | None:
    """What keeps a link from being live, None where nothing does or there is none."""
    if status.state in ("off", "live"):
        return None
    if status.state == "lost":
        return link_lost(link, status.error)
    what = CONNECTING[link] if status.state == "connecting" else SILENT[link]
    return what if status.error is None else Message("of-source", source=what, reason=status.error)
