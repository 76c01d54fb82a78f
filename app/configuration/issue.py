"""One thing that a rule has to say about a configuration."""

from dataclasses import dataclass, replace
from typing import Literal

from app.words import Message, Quantity, Text, render
from firmware_protocol.config_image import FieldError, field_error
from firmware_protocol.memory_map import CONFIG, element_name

Level = Literal["error", "warning", "notice"]


@dataclass(frozen=True, slots=True)
class ConfigIssue:
    """An error blocks the write; a warning needs a reason, unless it stands already.

    A notice is for people: the page asks for a reason, a program may write without one.
    """

    level: Level
    code: str
    error: FieldError  # in the protocol's words: the field, its value, and the limit
    limit: Text
    why: Text
    is_standing: bool = False  # the configuration in force has it too

    @property
    def message(self) -> Message:
        """One line with field, value, limit and why."""
        field = CONFIG[self.error.field]
        is_id = field.name.endswith("_msg_id")
        value = f"{self.error.value:#x}" if is_id else Quantity(self.error.value, field.unit)
        name = element_name(field, self.error.element or 0)
        return Message("finding", field=name, value=value, limit=self.limit, why=self.why)

    @property
    def blocks(self) -> bool:
        """No reason helps."""
        return self.level == "error"

    @property
    def needs_reason(self) -> bool:
        """It may be written with a reason."""
        return self.level == "warning" and not self.is_standing

    def stands(self) -> "ConfigIssue":
        """The same, in force already."""
        return replace(self, is_standing=True)


def finding(level: Level, code: str, image: bytes, name: str, element: int, limit: Text, why: Message) -> ConfigIssue:
    """Return a finding about one element of an image."""
    field = CONFIG[name]
    error = field_error(field, element, field.unpack(image)[element], render(limit), render(why))
    return ConfigIssue(level, code, error, limit, why)
