"""How long to wait before trying again."""

import random
from dataclasses import dataclass, field


@dataclass
class Backoff:
    """Exponential with jitter and a cap; `reset` after a success."""

    first_s: float = 0.2
    cap_s: float = 2.0
    rng: random.Random = field(default_factory=random.Random)
    _next_s: float = 0.0

    def reset(self) -> None:
        """The next failure waits shortly again."""
        self._next_s = 0.0

    def next_s(self) -> float:
        """Return the wait after one more failure: at most cap_s, at least half of the step."""
        self._next_s = min(self.cap_s, self._next_s * 2 or self.first_s)
        return self._next_s * (0.5 + self.rng.random() / 2)
