"""Estimates of a session as they were recorded, looked up by time; a minute of them is kept at hand."""

import numpy as np

from app.estimation.arrays import FloatArray
from app.sessions.reading.reader import SessionFile

_PIECE_S = 60.0
_OLDEST_S = 2.0  # an estimate that is older than this says nothing of now
_NAMES = ("estimate.soc", "estimate.soc_sigma")


class RecordedEstimates:
    """State of charge of every cell and its standard deviation, as recorded."""

    def __init__(self, session: SessionFile) -> None:
        self._session = session
        self._from_s, self._to_s = np.inf, -np.inf
        self._time_s: FloatArray = np.empty(0)
        self._rows: tuple[FloatArray, FloatArray] = (np.empty((0, 0)), np.empty((0, 0)))

    def at(self, t_mono_ns: int) -> tuple[FloatArray, FloatArray] | None:
        """Return (soc, sigma) of every cell as they were known at an instant, None where nothing was recorded."""
        unix_s = self._session.unix_s(t_mono_ns)
        if not self._from_s <= unix_s <= self._to_s:
            self._load(unix_s)
        at = int(np.searchsorted(self._time_s, unix_s + 1e-6, side="right")) - 1
        if at < 0 or unix_s - self._time_s[at] > _OLDEST_S:
            return None
        return self._rows[0][at], self._rows[1][at]

    def _load(self, unix_s: float) -> None:
        self._from_s, self._to_s = unix_s, unix_s + _PIECE_S
        pieces = [
            [samples[name] for name in _NAMES]
            for samples in self._session.fields(_NAMES, unix_s - _OLDEST_S, self._to_s + 1e-3)
            if all(name in samples for name in _NAMES)
        ]
        if not pieces:
            self._time_s = np.empty(0)
            return
        self._time_s = np.concatenate([soc.time_s for soc, _ in pieces])
        self._rows = (
            np.concatenate([soc.values for soc, _ in pieces]),
            np.concatenate([sigma.values for _, sigma in pieces]),
        )
