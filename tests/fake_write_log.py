"""What became of changes of the configuration, kept for a test to look at."""

from dataclasses import dataclass, field


@dataclass
class FakeWriteLog:
    """Keeps what was told, in order."""

    told: list[tuple] = field(default_factory=list)

    def begun(self, attempt):
        attempt.number = 1

    def written(self, attempt, changes):
        self.told.append(("written", attempt, changes))

    def stored(self, attempt):
        self.told.append(("stored", attempt))

    def loaded(self, attempt, changes):
        self.told.append(("loaded", attempt, changes))

    def failed(self, attempt, error, result):
        self.told.append(("failed", attempt, error, result))
