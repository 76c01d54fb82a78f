"""Sources of a whole configuration, by name: to compare two of them, and to start a write from.

`in-force`, `stored`, `default`, `profile:NAME` or `profile:NAME@3`, `record:7` (what the write made) or
`record:7:before`, `session:ID` (in force at its end).
"""

from collections.abc import Callable

from app.configuration.configuration_store import ConfigurationStore
from app.configuration.history import ConfigHistory
from app.configuration.safe_write import ConfigurationWriter
from app.errors import AppError, ConfigError
from app.sessions.catalogue import Catalogue
from app.words import Message
from firmware_protocol.config_image import default_image
from firmware_protocol.memory_map import CONFIG_SIZE
from firmware_protocol.older_maps import present_image

NAMES = Message("source-names")


class NoSource(AppError):
    """The name is understood, and there is no configuration behind it."""


class ConfigSources:
    """Resolves names."""

    def __init__(
        self,
        configuration: ConfigurationWriter,
        in_force: Callable[[], bytes | None],
        profiles: ConfigurationStore,
        history: ConfigHistory,
        catalogue: Catalogue,
    ) -> None:
        self._configuration = configuration
        self._in_force = in_force
        self._profiles = profiles
        self._history = history
        self._catalogue = catalogue

    def image(self, name: str) -> bytes:
        """Return the 420 bytes behind a name.

        Raises:
            ConfigError: it is no name of a source.
            NoSource, NoProfile, SessionError: there is nothing behind it.
            LinkError: the EEPROM cannot be read.
        """
        kind, _, rest = name.partition(":")
        match kind:
            case "in-force" if not rest:
                return self._known(self._in_force(), Message("in-force-never-read"))
            case "stored" if not rest:
                stored = self._configuration.read_stored()
                return self._known(None if stored is None else stored.image, Message("nothing-stored"))
            case "default" if not rest:
                return default_image()
            case "profile":
                profile, _, version = rest.partition("@")
                return self._profiles.load(profile, _number(name, version) if version else None).image
            case "record":
                number, _, which = rest.partition(":")
                return self._of_record(_number(name, number), which)
            case "session" if rest:
                with self._catalogue.open(rest) as session:
                    configs = session.configs()
                return self._known(
                    configs[-1].image if configs else None, Message("session-without-config", session=rest)
                )
        raise ConfigError("source", name[:80], NAMES)

    def _of_record(self, number: int, which: str) -> bytes:
        if which not in ("", "before"):
            raise ConfigError("source", f"record:{number}:{which[:20]}", NAMES)
        record = self._history.record(number)
        if record is None:
            raise NoSource(Message("no-record", number=number))
        image = record.before if which else record.after
        return self._known(
            present_image(image) if len(image) == CONFIG_SIZE else None,
            Message("record-without-config", number=number),
        )

    @staticmethod
    def _known(image: bytes | None, otherwise: Message) -> bytes:
        if image is None:
            raise NoSource(otherwise)
        return image


def _number(name: str, text: str) -> int:
    if not text.isascii() or not text.isdigit() or len(text) > 9:
        raise ConfigError("source", name[:80], NAMES)
    return int(text)
