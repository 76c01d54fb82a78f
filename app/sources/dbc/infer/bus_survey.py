"""Messages on a bus with their rates, signals with their ranges."""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from numpy.typing import NDArray

from app.estimation.arrays import FloatArray
from app.sources.dbc.decoder import MessageFrames, by_message, physical_values, raw_values
from app.sources.dbc.definitions import Definitions, MessageDefinition, SignalDefinition
from app.sources.dbc.frames import Frames

_MOST_KEPT = 200_000  # frames of one message; a survey needs no more
_MOST_DISTINCT = 4096


@dataclass(frozen=True, slots=True)
class ReceivedSignal:
    """A signal's values in the order of their frames, in the unit of the DBC."""

    t_ns: NDArray[np.int64]
    values: FloatArray
    raw: NDArray[np.int64]

    @property
    def low(self) -> float:
        """The lowest value."""
        return float(np.nanmin(self.values))

    @property
    def high(self) -> float:
        """The highest value."""
        return float(np.nanmax(self.values))


@dataclass(slots=True)
class ReceivedMessage:
    """The frames of one message."""

    message: MessageDefinition
    group: MessageFrames
    _signals: dict[str, ReceivedSignal | None] = field(default_factory=dict)

    @property
    def rate_hz(self) -> float:
        """Frames a second while the message is received; NaN of one frame."""
        t_ns = self.group.frames.t_ns
        span_s = (int(t_ns[-1]) - int(t_ns[0])) / 1e9
        return (len(t_ns) - 1) / span_s if span_s > 0 else float("nan")

    def signal(self, name: str) -> ReceivedSignal | None:
        """Return the received values of a signal; None: no frame carries it."""
        if name not in self._signals:
            self._signals[name] = self._decoded(self.message.signal(name))
        return self._signals[name]

    def _decoded(self, signal: SignalDefinition | None) -> ReceivedSignal | None:
        if signal is None or signal.layout.end_byte > self.group.frames.data.shape[1]:
            return None
        here = self.group.carrying(signal)
        frames = self.group.frames if here is None else self.group.frames.part(np.flatnonzero(here))
        if not len(frames):
            return None
        raw = raw_values(frames.data, signal.layout)
        return ReceivedSignal(frames.t_ns, physical_values(raw, signal.layout), raw.astype(np.int64))


@dataclass(frozen=True, slots=True)
class BusSurvey:
    """Definitions and what was received of them."""

    definitions: Definitions
    received: dict[int, ReceivedMessage]  # by id
    unknown: dict[int, int]  # frames of ids that no message has
    n_frames: int
    duration_s: float

    def of(self, message: MessageDefinition) -> ReceivedMessage | None:
        """Return what was received of a message."""
        return self.received.get(message.can_id)

    def signal(self, message: MessageDefinition, name: str) -> ReceivedSignal | None:
        """Return the received values of a signal of a message."""
        received = self.of(message)
        return None if received is None else received.signal(name)


def survey_bus(definitions: Definitions, frames: Frames) -> BusSurvey:
    """Return what was received, by the definitions."""
    by_id = definitions.by_id()
    received = {
        group.message.can_id: ReceivedMessage(group.message, _thinned(group)) for _, group in by_message(frames, by_id)
    }
    ids, counts = np.unique(frames.can_id, return_counts=True)
    unknown = {int(i): int(n) for i, n in zip(ids, counts, strict=True) if int(i) not in by_id}
    span_s = (int(frames.t_ns.max()) - int(frames.t_ns.min())) / 1e9 if len(frames) else 0.0
    return BusSurvey(definitions, received, unknown, len(frames), span_s)


def _thinned(group: MessageFrames) -> MessageFrames:
    return (
        group if len(group.frames) <= _MOST_KEPT else MessageFrames(group.message, group.frames.part(slice(_MOST_KEPT)))
    )


def distinct(received: Iterable[ReceivedSignal | None]) -> NDArray[np.int64]:
    """Return the whole numbers that signals took, sorted; empty where one is not whole or they are too many."""
    whole: set[int] = set()
    for series in received:
        if series is None:
            continue
        values = np.unique(series.values)
        if len(values) > _MOST_DISTINCT or not np.array_equal(values, np.rint(values)):
            return np.empty(0, np.int64)
        whole |= {int(value) for value in values}
    return np.array(sorted(whole), np.int64)


def name_set(text: str) -> frozenset[str]:
    """Return the words of a text."""
    return frozenset(text.split())


_TOKEN = re.compile(
    r"So[CHE](?![a-z])|AIR(?![a-z]{2})|m[VA](?![A-Za-z])|[A-ZÄÖÜÆØÅ]+(?![a-zäöüßæøå])|[A-ZÄÖÜÆØÅ]?[a-zäöüßæøå]+|\d+|[^\W\d_]+"
)  # mV, mA, SoC and the AIR of AIRp stay whole
VOLTAGE = name_set(
    "v u mv volt volts voltage voltages vcell cellv cv cvolt vc spannung spannungen spenning spänning spænding "
    "tension tensions tensione tensioni tensao tensão voltaje napiecie napětí napeti napetost spanning gerilim "
    "jannite jännite feszultseg uc uz zv vz vcel potential"
)
CELL = name_set(
    "cell cells zelle zellen zell celle cella celler cellule cellules celda celdas celula celulas célula cv vcell "
    "cellv vc ct tcell cvolt brick tap mono block batt cel cellen ogniwo ogniwa clanek clanku celica hucre kenno "
    "cella vcel zv ze"
)
TEMPERATURE = name_set(
    "t temp temps temperature temperatures temperatur temperaturen temperatura temperaturas temperaturer therm "
    "thermistor thermistors ntc tmp tcell ct tc degc tz"
)
NOT_A_CELL = name_set(
    "min max minimum maximum avg average mean median mittel lowest highest low high lo hi delta diff spread "
    "limit limits lim thresh threshold thrs target set setpoint setting request req cmd command over under ov "
    "uv ot ut ocv open sum total bal balance balancing shunt discharge fault faults error errors err flag "
    "flags status state valid invalid count counter cnt crc checksum chk alive rolling version resist "
    "resistance res ir ohm soc soh soe dod capacity energy power current motor phase inverter inv mc mcu lv "
    "glv lvs pedal apps throttle brake steering coolant water oil fan pump radiator charger chg precharge "
    "dcdc ref reference vref variance stddev std imbalance hysteresis calibration calib trip warn warning "
    "alarm supply id index idx num number adjusted corrected compensated filtered pcb ambient"
)
SEGMENT = name_set(
    "seg segs segment segments segm module modul mod mods stack slave ic ics chip board bank bmb bmu cmu csc "
    "cmb pack string ltc afe adbms unit section box brd tray node daughter device dev sub submodule vtm bms "
    "satellite peripheral perif"
)
GROUP = name_set(
    "group grp grps page mux multiplexer multiplexor start first base frame part row block offset set packet "
    "selector from"
)
FIRST = name_set("start first base offset from")
NUMBER = name_set(
    "id idx ids index num number nr no nbr n cell cells sensor thermistor therm channel ch pos position mux ntc temp"
)
NO_NUMBER = name_set(
    "counter cnt crc checksum chk alive rolling version state status flags error fault count total max min "
    "highest lowest heartbeat seq sequence"
)
NO_QUANTITY = name_set("crc checksum chk counter cnt alive rolling heartbeat seq sequence reserved unused blank")
CURRENT = name_set(
    "current currents curr cur strom strøm ström stroom corrente corriente courant prad proud tok akim virta i amp "
    "amps amperage ipack ibat ibatt"
)
PACK = name_set(
    "pack batt battery bat batterie batteria bateria batterij batteri akku accumulator accumulatore accu acc pacco "
    "hv hvb ts tractive bms ams bus dc link ivt shunt string stack total totale sum gesamt summe instant inst result"
)
CHARGER = name_set("charger chg obc elcon brusa nlg onboard")
NOT_THE_PACK = name_set(
    "limit lim limits max min maximum minimum avg average abs absolute motor phase iq id iqs ids inverter inv "
    "mc charger chg obc request req target cmd command set setpoint ccl dcl lv glv lvs fan fans pump pumps "
    "coolant cooling radiator heater fault error adc raw warning threshold thresh high low over under trip peak "
    "allowed available capability dcdc brake steering fuse rms ref reference cell cells counter cnt state status "
    "valid temp temperature power energy kw wh ah offset regen front rear left right"
)


SOC = name_set("soc ladezustand ladestand")
_JOINED = VOLTAGE | CELL | TEMPERATURE | CURRENT | PACK | SEGMENT
_LEAST_PART = 3  # letters of a word that another is joined to


@cache
def tokens(name: str) -> tuple[str, ...]:
    """Return the words and numbers of a name, in lower case; `Zellspannung` and `cellvoltage` are two words."""
    return tuple(part for token in _TOKEN.findall(name) for part in _parted(token.lower()))


def _parted(token: str) -> tuple[str, ...]:
    for at in range(_LEAST_PART, len(token) - _LEAST_PART + 1):
        if token[:at] in _JOINED and token[at:] in _JOINED:
            return token[:at], token[at:]
    return (token,)


def words(name: str) -> frozenset[str]:
    """Return the words of a name without its numbers."""
    return frozenset(token for token in tokens(name) if not token.isdigit())


def skeleton(name: str) -> str:
    """Return a name with `#` for each number."""
    return re.sub(r"\d+", "#", name)


def numbers(name: str) -> tuple[int, ...]:
    """Return the numbers of a name from left to right."""
    return tuple(int(digits) for digits in re.findall(r"\d+", name))
