"""What the service can fail at; each leaf is something a caller handles differently.

AppError
  ConfigError          a setting or a file of the user's is wrong: field, value, limit
  LinkError            LinkLost, MasterSilent, MasterRefused
  ImportFailed         another program's recording cannot be taken over
  ExtraMissing         an optional package is missing
  NotNow               the request is fine, the moment is not
"""


class AppError(Exception):
    """Root of the service's own errors."""


class ConfigError(AppError):
    """A setting cannot be used."""

    def __init__(self, field: str, value: object, limit: str) -> None:
        self.field = field
        self.value = value
        self.limit = limit
        super().__init__(f"{field} = {value}: {limit}")


class LinkError(AppError):
    """The master cannot be talked to."""


class LinkLost(LinkError):
    """The port is not open."""


class MasterSilent(LinkError):
    """The port is open, the master did not answer in time."""


MEANINGS = {  # of results that carry no offset
    "UNKNOWN_REQUEST": "its firmware does not know it",
    "NOT_NOW": "its state forbids it: driving, charging, a fault, or a store under way",
    "EEPROM_FAILED": "the EEPROM does not answer, or does not keep what is written",
    "NOTHING_STORED": "its EEPROM holds no valid configuration",
}


class MasterRefused(LinkError):
    """The master answered with a refusal."""

    def __init__(self, request: str, result: str, offset: int | None = None) -> None:
        self.request = request
        self.result = result
        self.offset = offset
        where = "" if offset is None else f" (offset {offset})"
        means = f", {MEANINGS[result]}" if result in MEANINGS else ""
        super().__init__(f"the master refused {request}: {result}{where}{means}")


class NotNow(AppError):
    """The state of the service forbids it."""


class ImportFailed(AppError):
    """A recording of another program cannot be read as one of a battery."""

    def __init__(self, source: str, reason: str) -> None:
        self.source = source
        self.reason = reason
        super().__init__(f"{source}: {reason}")


class ExtraMissing(AppError):
    """A format needs a package that is not installed."""

    def __init__(self, what: str, package: str, extra: str) -> None:
        self.what = what
        self.package = package
        super().__init__(f"{what} needs {package}: pip install 'voltwall[{extra}]'")
