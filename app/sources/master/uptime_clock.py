"""The master's uptime on our clock: when was measured what arrived later."""

import numpy as np
from numpy.typing import NDArray

UPTIME_WRAP_MS = 1 << 32
DRIFT = 500e-6  # relative drift of both crystals together
_HALF_WRAP_MS = UPTIME_WRAP_MS // 2


class UptimeClock:
    """Maps the master's uptime to the monotonic clock by a minimum-delay filter.

    A frame arrives at uptime + offset + delay, and no delay is negative: the least of all differences between arrival
    and uptime belongs to the frame that waited least. What a frame has above it, it has waited. Source: RFC 5905,
    clock filter. The clocks drift apart, so the offset may grow by DRIFT; where a link knows for how long at most its
    frame has waited, the offset grows as far as that says, whatever the master's clock does.
    """

    def __init__(self) -> None:
        self._offset_ns: int | None = None
        self._uptime_ms = 0  # uptime of the newest frame, without its wraps
        self._arrived_ns = 0

    def measured_ns(self, uptime_ms: int, arrived_ns: int, waited_max_ns: int | None = None) -> int:
        """Return the monotonic time at which the master sent a frame, at the latest its arrival.

        Args:
            uptime_ms: of the frame, 0..2^32-1; one that goes back is a reset of the master.
            arrived_ns: monotonic time at which its last byte was read.
            waited_max_ns: it waited at most so long since it arrived at this computer; None = not known.
        """
        step_ms = (uptime_ms - self._uptime_ms) % UPTIME_WRAP_MS
        difference_ns = arrived_ns - (self._uptime_ms + step_ms) * 1_000_000
        if self._offset_ns is None or step_ms > _HALF_WRAP_MS:
            step_ms = uptime_ms - self._uptime_ms
            difference_ns = arrived_ns - uptime_ms * 1_000_000
            self._offset_ns = difference_ns
        drifted_ns = self._offset_ns + round(DRIFT * max(0, arrived_ns - self._arrived_ns))
        if waited_max_ns is not None:
            drifted_ns = max(drifted_ns, difference_ns - waited_max_ns)
        self._offset_ns = min(drifted_ns, difference_ns)
        self._uptime_ms += step_ms
        self._arrived_ns = arrived_ns
        return arrived_ns - (difference_ns - self._offset_ns)

    def all_measured_ns(self, uptimes_ms: NDArray[np.int64], arrived_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return (n,) what `measured_ns` returns for one frame after the other, without a loop where no master resets.

        The least of all differences, each grown by the drift since: one running minimum of what is left of them
        without all the drift so far.
        """
        steps_ms = np.diff(uptimes_ms, prepend=self._uptime_ms) % UPTIME_WRAP_MS
        if (steps_ms[1:] > _HALF_WRAP_MS).any():
            frames = zip(uptimes_ms.tolist(), arrived_ns.tolist(), strict=True)
            return np.array([self.measured_ns(*frame) for frame in frames], np.int64)
        if len(steps_ms) and (self._offset_ns is None or steps_ms[0] > _HALF_WRAP_MS):
            first_ns = self.measured_ns(int(uptimes_ms[0]), int(arrived_ns[0]))
            return np.append(np.int64(first_ns), self.all_measured_ns(uptimes_ms[1:], arrived_ns[1:]))
        unwrapped_ms = self._uptime_ms + np.cumsum(steps_ms)
        differences_ns = arrived_ns - unwrapped_ms * 1_000_000
        passed_ns = np.maximum(np.diff(arrived_ns, prepend=self._arrived_ns), 0)
        drift_ns = np.cumsum(np.rint(DRIFT * passed_ns).astype(np.int64))
        least_ns = np.minimum.accumulate(differences_ns - drift_ns)
        offsets_ns = np.minimum(least_ns, self._offset_ns or 0) + drift_ns
        if len(offsets_ns) > 0:
            self._offset_ns = int(offsets_ns[-1])
            self._uptime_ms, self._arrived_ns = int(unwrapped_ms[-1]), int(arrived_ns[-1])
        return np.asarray(arrived_ns - (differences_ns - offsets_ns))
