"""Results of the check of a link."""

from dataclasses import dataclass

from app.words import Message, Text

CHECK_S = 1.5
POLL_S = 0.1
BATTERY_S = 1.0  # for frames of another battery
SETTING_S = 0.7  # for frames at another setting of the port


@dataclass(frozen=True, slots=True)
class Trial:
    """Result at one setting of the port or one bit rate."""

    setting: str  # "115200 8E1", "500 kbit/s"
    bytes: int
    frames: int
    errors: int | None = None  # error frames; None where the adapter hands none on
    battery: str | None = None  # whose frames were counted, where it is not the chosen one


@dataclass(frozen=True, slots=True)
class LinkCheck:
    """Result of listening for `seconds`, and the remedy where something is not right."""

    url: str  # with the bit rate that gave frames
    seconds: float = CHECK_S
    bytes: int = 0
    frames: int = 0
    error: Text | None = None
    advice: Message | None = None
    trials: tuple[Trial, ...] = ()
    batteries: tuple[str, ...] = ()  # whose messages were received
    has_checksum: bool | None = None  # None: unknown, or CAN, which has its own

    @property
    def rate_hz(self) -> float:
        """Frames a second."""
        return self.frames / self.seconds if self.seconds else 0.0
