"""One thing that a rule has to say about a configuration."""

from dataclasses import dataclass, replace
from typing import Literal

from firmware_protocol.config_image import FieldError, field_error
from firmware_protocol.memory_map import CONFIG


@dataclass(frozen=True, slots=True)
class Finding:
    """An error blocks the write; a warning needs a reason, unless it stands already."""

    level: Literal["error", "warning"]
    code: str
    error: FieldError
    is_standing: bool = False  # the configuration in force has it too

    @property
    def blocks(self) -> bool:
        """No reason helps."""
        return self.level == "error"

    @property
    def needs_reason(self) -> bool:
        """It may be written with a reason."""
        return self.level == "warning" and not self.is_standing

    def stands(self) -> "Finding":
        """The same, in force already."""
        return replace(self, is_standing=True)


def finding(
    level: Literal["error", "warning"], code: str, image: bytes, name: str, element: int, limit: str, why: str
) -> Finding:
    """Return a finding about one element of an image."""
    field = CONFIG[name]
    return Finding(level, code, field_error(field, element, field.unpack(image)[element], limit, why))
