"""What is known of the master's configuration: what is in force, since when, and what the rules say about it."""

from app.clock import Clock
from app.configuration.allowed_range import allowed_ranges
from app.configuration.finding import Finding
from app.configuration.rules import Context, review
from app.configuration.safe_write import ConfigurationWriter
from app.estimation.cell_model.circuit import CellModel
from app.live.can_trace import CanTrace
from app.live.pipeline import Output
from firmware_protocol.config_image import image_hash


class Rules:
    """The rules with what they are judged by: the cell, and the periods measured on the CAN bus."""

    def __init__(self, cell: CellModel, trace: CanTrace) -> None:
        self._cell = cell
        self._trace = trace

    def context(self) -> Context:
        """Return what the rules need to know now."""
        periods_s = {can_id: seen.period_s for can_id, seen in self._trace.by_id().items() if seen.period_s is not None}
        return Context(self._cell, periods_s)

    def review(self, image: bytes) -> list[Finding]:
        """Return what the rules say about a configuration."""
        return review(image, self.context())

    def allowed_ranges(self, image: bytes) -> dict[str, tuple[int, int]]:
        """Return what each field may be while the others stay [raw counts]."""
        return allowed_ranges(image, self.context())


class ConfigurationInForce:
    """The newer of what the stream brought as a whole and what was read back after a write."""

    def __init__(self, configuration: ConfigurationWriter, clock: Clock) -> None:
        self._configuration = configuration
        self._clock = clock
        self._received: tuple[int, bytes] | None = None  # monotonic ns, image

    def on_output(self, output: Output, t_mono_ns: int) -> None:
        """Keep the configuration that the stream brought."""
        snapshot = output.snapshot
        if snapshot is None or snapshot.config is None:
            return
        age_s = snapshot.age_s.config
        if age_s is not None:
            self._received = snapshot.t_mono_ns - int(age_s * 1e9), snapshot.config

    def image(self) -> bytes | None:
        """Return the 420 bytes as last received or read, None before the first time."""
        return None if (known := self._newest()) is None else known[1]

    def age_s(self) -> float | None:
        """Return the seconds since the configuration was received or read."""
        return None if (known := self._newest()) is None else max(0.0, (self._clock.monotonic_ns() - known[0]) / 1e9)

    def stored_hash(self) -> str | None:
        """Return the hash of what the EEPROM holds, None where it was not read or holds nothing."""
        return None if (stored := self._configuration.stored) is None else image_hash(stored.image)

    def _newest(self) -> tuple[int, bytes] | None:
        known = [each for each in (self._received, self._configuration.last_read) if each is not None]
        return max(known, key=lambda each: each[0], default=None)
