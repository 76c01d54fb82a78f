"""How often the truth fell into the band of a prediction, and how far off its median was: a line of the table."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Set
from dataclasses import dataclass, field

import numpy as np

from tests.numeric.prediction_races import RaceRun, fly_ahead


@dataclass
class Score:
    """What was foretold and what came, pair by pair; an endless one counts as the longest that is looked at."""

    low: list[float] = field(default_factory=list)
    middle: list[float] = field(default_factory=list)
    high: list[float] = field(default_factory=list)
    truth: list[float] = field(default_factory=list)

    def add(self, low: float, middle: float, high: float, truth: float) -> None:
        """Take one prediction and its truth."""
        for values, value in zip(
            (self.low, self.middle, self.high, self.truth), (low, middle, high, truth), strict=True
        ):
            values.append(value)

    def coverage(self) -> float:
        """Share of the truths that lay within their band."""
        low, high, truth = (np.array(values) for values in (self.low, self.high, self.truth))
        return float(((truth >= low) & (truth <= high)).mean())

    def line(self, name: str) -> str:
        """Return a row of Markdown: moments, share in the band, below and above it, median off, bias, half the band."""
        low, middle, high, truth = (np.array(v) for v in (self.low, self.middle, self.high, self.truth))
        scale = np.maximum(np.abs(truth), 1e-9)
        off = (middle - truth) / scale
        shares = 100 * self.coverage(), 100 * (truth < low).mean(), 100 * (truth > high).mean()
        inside, below, above = (f"{share:.0f}" for share in shares)
        return (
            f"| {name} | {truth.size} | {inside} % | {below} / {above} % | {100 * np.median(np.abs(off)):.1f} % | "
            f"{100 * np.median(off):+.1f} % | {100 * np.median((high - low) / 2 / scale):.1f} % |"
        )


def score_race(run: RaceRun, scores: dict[str, Score], only: Set[str] | None = None) -> None:
    """Add the probes of a race, of all predictions or `only` of some."""
    for probe in run.probes:
        for name, low, middle, high, truth in fly_ahead(run, probe, only):
            scores[name].add(low, middle, high, truth)


def race_scores(
    scenario: str, seeds: Iterable[int], every_s: float, seconds: float = 1e9, only: Set[str] | None = None
) -> dict[str, Score]:
    """Return the scores of some races by prediction, of all or `only` of some."""
    scores: dict[str, Score] = defaultdict(Score)
    for seed in seeds:
        score_race(RaceRun(scenario, seed, every_s, seconds), scores, only)
    return scores
