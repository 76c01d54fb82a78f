"""The bus of a log that is read: an id that is on two of them has two meanings."""

from collections import defaultdict
from collections.abc import Container

from app.errors import ImportFailed
from app.words import Message
from firmware_protocol.memory_map import CAN_ID_EXTENDED

_NAMED = 5  # ids


class Buses:
    """The ids of each bus, fed while a log is read."""

    def __init__(self, chosen: str = "") -> None:
        """`chosen`: the bus that is read; empty: all."""
        self.chosen = chosen
        self._ids: dict[str, set[int]] = defaultdict(set)

    def keeps(self, bus: str, can_id: int) -> bool:
        """Return whether a frame is of the bus that is read."""
        self._ids[bus].add(can_id)
        return not self.chosen or bus == self.chosen

    def check(self, source: str, wanted: Container[int] | None = None) -> None:
        """Refuse a log of which two buses would be read as one.

        Args:
            source: name of the log.
            wanted: ids that are decoded; None: all.

        Raises:
            ImportFailed: an id is on two buses and none is chosen, or the chosen one has no frames.
        """
        names = tuple(sorted(self._ids))
        if self.chosen:
            if self.chosen not in self._ids:
                raise ImportFailed(source, Message("log-no-bus", bus=self.chosen, buses=names))
            return
        seen: dict[int, str] = {}
        shared = set()
        for bus, ids in self._ids.items():
            for can_id in ids:
                if seen.setdefault(can_id, bus) != bus and (wanted is None or can_id in wanted):
                    shared.add(can_id)
        if shared:
            named = [*(_hex(can_id) for can_id in sorted(shared)[:_NAMED]), *(["..."] if len(shared) > _NAMED else [])]
            raise ImportFailed(source, Message("log-two-buses", ids=", ".join(named), buses=names, first=names[0]))


def _hex(can_id: int) -> str:
    return f"{can_id & 0x1FFFFFFF:08X}" if can_id & CAN_ID_EXTENDED else f"{can_id:03X}"
