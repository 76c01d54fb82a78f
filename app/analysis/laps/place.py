"""Position of the car on the lap, by a speed or a place that the session holds: laps lie on each other by distance."""

import re

import numpy as np

from app.analysis.laps.figures import Lap
from app.errors import ConfigError
from app.estimation.arrays import FloatArray
from app.sessions.errors import UnknownSignal
from app.sessions.reading.reader import MAX_POINTS, SessionFile
from app.sources.dbc.decoder import decode_frames
from app.sources.dbc.definitions import Definitions
from app.sources.dbc.frames import frames_of
from app.words import Message

AUTO = "auto"
_SOUNDS = re.compile(r"speed|velocity|odometer|distance|lap_?(fraction|progress|position)", re.IGNORECASE)
_ANOTHER = re.compile(r"fan|pump|wind|limit|target|setpoint|max|min", re.IGNORECASE)
_FRAME = re.compile(r"can:(0x[0-9a-f]{1,8}|\d{1,10}):(\d{1,2})(?::([1-4]))?", re.IGNORECASE)
_RISES_A_FALL = 10  # at least, of a place: a lap fraction begins again once; a speed falls as often as it rises


def known_places(session: SessionFile) -> list[str]:
    """Return the signals of the battery's DBC that sound like a speed or a place, as `MESSAGE.SIGNAL`."""
    return [
        f"{message.name}.{signal.name}"
        for message in session.loaded_battery.definitions.messages
        for signal in message.signals
        if _SOUNDS.search(signal.name) and not _ANOTHER.search(signal.name)
    ]


def place_of(session: SessionFile, name: str, lap: Lap) -> tuple[FloatArray, FloatArray]:
    """Return unix times [s] and values of a speed or a place in a lap, (n,) each.

    Args:
        session: that the lap is of.
        name: a signal of the session, `MESSAGE.SIGNAL` of the battery's DBC, or `can:ID:BYTE[:BYTES]`, an unsigned
            little-endian number in a frame, of two bytes by default.
        lap: the span.

    Raises:
        UnknownSignal: the name means nothing.
    """
    frame = _FRAME.fullmatch(name)
    if frame is not None:
        can_id, first, size = int(frame[1], 0), int(frame[2]), int(frame[3] or 2)
        rows = [
            (session.unix_s(frame.t_mono_ns), float(int.from_bytes(frame.data[first : first + size], "little")))
            for frame in session.can_frames(lap.start_s, lap.end_s)
            if frame.can_id == can_id and len(frame.data) >= first + size
        ]
        table = np.array(rows, dtype=np.float64).reshape(-1, 2)
        return table[:, 0], table[:, 1]
    message = next(
        (
            message
            for message in session.loaded_battery.definitions.messages
            if name.startswith(f"{message.name}.") and message.signal(name.removeprefix(f"{message.name}.")) is not None
        ),
        None,
    )
    if message is None:
        series = session.series([name], lap.start_s, lap.end_s, points=MAX_POINTS)[name]
        return series.time_s, series.maximum
    frames = frames_of(
        [
            (frame.t_mono_ns, frame.can_id, frame.data)
            for frame in session.can_frames(lap.start_s, lap.end_s)
            if frame.can_id == message.can_id
        ]
    )
    decoded = decode_frames(frames, Definitions((message,))).get((message.name, name.removeprefix(f"{message.name}.")))
    if decoded is None:
        return np.empty(0), np.empty(0)
    return np.array([session.unix_s(t_ns) for t_ns in decoded.t_ns.tolist()]), decoded.values


def share_of_way(time_s: FloatArray, values: FloatArray, at_s: FloatArray) -> FloatArray | None:
    """Return the (k,) share of the lap's way at some times, 0..1; None where nothing moved.

    What goes up and hardly ever down is a place, as a distance or a lap fraction; anything else is a speed.

    Args:
        time_s: (n,) rising.
        values: (n,) in any unit; NaN where missing.
        at_s: (k,) times.
    """
    is_finite = np.isfinite(values)
    time_s, values = time_s[is_finite], values[is_finite]
    if len(values) < 2:
        return None
    steps = np.diff(values)
    rises, falls = np.count_nonzero(steps > 0.0), np.count_nonzero(steps < 0.0)
    is_place = rises > 0 and rises >= _RISES_A_FALL * falls
    speed = 0.5 * np.abs(values[1:] + values[:-1])
    moved = np.maximum(steps, 0.0) if is_place else speed * np.diff(time_s)
    way = np.concatenate([[0.0], np.cumsum(moved)])
    return np.asarray(np.interp(at_s, time_s, way / way[-1]), np.float64) if way[-1] > 0.0 else None


class Ways:
    """The ways of some laps of a session by one signal; by time where none of them is known in every lap."""

    def __init__(self, session: SessionFile, laps: list[Lap], along: str | None) -> None:
        """Read them.

        Args:
            session: that the laps are of.
            laps: those that are laid on each other.
            along: None for time, `AUTO` for what is known, else as `place_of` takes it.

        Raises:
            ConfigError: the signal that is named means nothing, or does not move.
        """
        self.places = known_places(session)
        self.along: str | None = None
        self._found: list[tuple[FloatArray, FloatArray]] = []
        names = self.places if along == AUTO else [along] if along else []
        for name in names:
            try:
                places = [place_of(session, name, lap) for lap in laps]
            except UnknownSignal as error:
                raise ConfigError("along", name, error.reason) from error
            if all(share_of_way(*place, place[0]) is not None for place in places):
                self.along, self._found = name, places
                return
            if along != AUTO:
                raise ConfigError("along", name, Message("does-not-move"))

    def shares(self, index: int, at_s: FloatArray) -> FloatArray | None:
        """Return the (k,) share of the way of one of the laps at some times; None: by time."""
        return share_of_way(*self._found[index], at_s) if self._found else None
