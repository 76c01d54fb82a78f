"""Why a change of the configuration was refused, or what is in force after one that failed."""

from app.configuration.finding import Finding
from app.errors import AppError, LinkError, NotNow
from app.words import Message, render
from firmware_protocol.config_image import image_hash
from firmware_protocol.memory_map import CONFIG

#: that a write may change while the accumulator drives, charges or balances
FIELDS_WRITABLE_AT_WORK = tuple(name for name, field in CONFIG.items() if field.is_live)


class HashMismatch(AppError):
    """The configuration in force is not the one that the draft started from; `wanted` is what it would have become."""

    def __init__(self, expected: str, base: bytes | None, in_force: bytes, wanted: bytes) -> None:
        self.expected = expected
        self.base = base  # what the draft started from, where it is still known
        self.in_force = in_force
        self.wanted = wanted
        super().__init__(Message("hash-mismatch", in_force=image_hash(in_force), expected=expected))


class Rejected(AppError):
    """The draft breaks limits."""

    def __init__(self, findings: list[Finding]) -> None:
        self.findings = findings
        super().__init__(Message("list", shown=tuple(found.message for found in findings)))


class ReasonRequired(AppError):
    """The draft has warnings, and nobody said why it is right all the same."""

    def __init__(self, findings: list[Finding]) -> None:
        self.findings = findings
        super().__init__(Message("reason-needed", findings=tuple(found.message for found in findings)))


class Busy(NotNow):
    """The accumulator is at work, and the draft changes more than what may change meanwhile."""

    def __init__(self, doing: Message, fields: list[str]) -> None:
        self.doing = render(doing)
        self.fields = fields
        super().__init__(
            Message("only-at-rest", doing=doing, fields=tuple(fields), live=tuple(FIELDS_WRITABLE_AT_WORK))
        )


class Unverified(LinkError):
    """A write was sent and what is in force afterwards is not what was sent."""

    def __init__(self, outcome: str, detail: Message) -> None:
        self.outcome = outcome  # old | other | unknown
        super().__init__(detail)
