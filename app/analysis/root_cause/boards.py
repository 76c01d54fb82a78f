"""Hypotheses about the slave boards and the line between them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from app.analysis.root_cause.recording import Recording, Suspicion, pack_of
from app.estimation.arrays import BoolArray
from app.words import Message, Pack

CONVERTER_BITS: Final = 1 | 2 | 4  # cells, auxiliary, status: what is converted is wrong
MULTIPLEXER_BIT: Final = 8


def board_suspicions(recording: Recording) -> Iterator[Suspicion]:
    """Yield what the boards' own tests, their silence and their damaged packets tell."""
    noisy = list(_line(recording))
    yield from noisy
    yield from _self_tests(recording)
    yield from _silent(recording, is_noisy=bool(noisy))


def _line(recording: Recording) -> Iterator[Suspicion]:
    damaged = np.nan_to_num(recording.boards.damaged)
    rows = np.flatnonzero((damaged > 0).sum(axis=1) >= 2)
    if rows.size < 2 and not (rows.size and damaged[rows].sum() > 20):
        return
    packs = int((damaged[rows].max(axis=0) > 0).sum())
    evidence = (Message("seen-damaged-packets", n=round(float(damaged[rows].sum(axis=1).mean())), packs=packs),)
    yield Suspicion("isospi-noise", float(recording.boards.time_s[rows[0]]) - 2.0, 30.0 + rows.size, evidence)


def _self_tests(recording: Recording) -> Iterator[Suspicion]:
    boards = recording.boards
    failed = np.nan_to_num(boards.failed_tests).astype(np.int64)
    for pack in np.flatnonzero(failed.any(axis=0)):
        rows = np.flatnonzero(failed[:, pack])
        bits = int(np.bitwise_or.reduce(failed[rows, pack]))
        code, seen = "slave-reference-drift", Message("seen-reference-test", pack=Pack(int(pack)))
        if bits & CONVERTER_BITS:
            code, seen = "slave-adc-fault", Message("seen-converter-test", pack=Pack(int(pack)))
        elif bits & MULTIPLEXER_BIT:
            code, seen = "slave-multiplexer-fault", Message("seen-multiplexer-test", pack=Pack(int(pack)))
        at_s = float(boards.time_s[rows[0]]) - 3.0  # a round of the slow windows and of the tests before
        yield Suspicion(code, at_s, 60.0, (seen,), pack=int(pack))


def _silent(recording: Recording, *, is_noisy: bool) -> Iterator[Suspicion]:
    if not recording.time_s.size:
        return
    lost = [event for event in recording.events if event.code == "trip-slave-lost" and event.cell is not None]
    missing: BoolArray = np.logical_and.reduceat(np.isnan(recording.voltage_v), recording.pack_starts, axis=1)
    if not recording.tells_at_once:  # what comes later in the first round is awaited
        missing &= np.logical_or.accumulate(~missing, axis=0) | missing.all(axis=0)
    tested = (np.nan_to_num(recording.boards.failed_tests) != 0).any(axis=0)
    packs = {pack for event in lost if (pack := pack_of(event.cell, recording.segments)) is not None}
    if not missing.all(axis=1).any():
        packs |= {int(pack) for pack in np.flatnonzero(missing.sum(axis=0) >= 5) if not tested[pack]}
    for pack in sorted(packs):
        rows = np.flatnonzero(missing[:, pack])
        at_s = float(recording.time_s[rows[0]]) if rows.size else lost[0].at_s
        weight = 10.0 if is_noisy else 60.0
        yield Suspicion("slave-lost", at_s, weight, (Message("seen-slave-silent", pack=Pack(pack)),), pack=pack)
