"""What a made-up battery of another team sends: signals, messages, frames, and what is true of them.

Frames are packed by whole integers, a way of its own, not by the code under test.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from math import sin

HEAD = 'VERSION ""\n\nNS_ :\n\nBS_:\n\nBU_: BMS VCU MC\n\n'
OHM = 0.002  # resistance of a cell
Value = Callable[[float], float]  # function of time [s]


@dataclass(frozen=True)
class Bits:
    """A signal of a DBC and what it shall carry; `mux` is the value of the multiplexer under which it stands."""

    name: str
    start: int
    length: int
    value: Value
    factor: float = 1.0
    offset: float = 0.0
    unit: str = ""
    order: int = 1  # 1 little endian, 0 big endian
    signed: bool = False
    mux: int | None = None
    is_mux: bool = False
    limits: tuple[float, float] = (0, 0)

    def line(self) -> str:
        mux = " M" if self.is_mux else ("" if self.mux is None else f" m{self.mux}")
        sign = "-" if self.signed else "+"
        return (
            f" SG_ {self.name}{mux} : {self.start}|{self.length}@{self.order}{sign} ({self.factor:g},{self.offset:g})"
            f' [{self.limits[0]:g}|{self.limits[1]:g}] "{self.unit}" Vector__XXX'
        )

    def packed(self, t: float, size: int) -> int:
        """Return the frame's bytes as one little-endian integer with this signal in it."""
        low, high = (
            (-(1 << (self.length - 1)), (1 << (self.length - 1)) - 1) if self.signed else (0, (1 << self.length) - 1)
        )
        raw = int(min(max(round((self.value(t) - self.offset) / self.factor), low), high)) & ((1 << self.length) - 1)
        if self.order == 1:
            return raw << self.start
        first = self.start // 8 * 8 + 7 - self.start % 8
        big = raw << (8 * size - first - self.length)
        return int.from_bytes(big.to_bytes(size, "big"), "little")


@dataclass(frozen=True)
class Sent:
    """A message; each of `turns` are the signals of one of its frames, sent in turn."""

    can_id: int
    name: str
    size: int
    period_s: float
    turns: list[list[Bits]]
    fix: Callable[[int, bytes], bytes] = lambda _, data: data

    def lines(self) -> str:
        seen: dict[str, Bits] = {}
        for turn in self.turns:
            for bits in turn:
                seen.setdefault(bits.name, bits)
        return "\n".join(
            [f"BO_ {self.can_id} {self.name}: {self.size} BMS", *(bits.line() for bits in seen.values()), "", ""]
        )


@cache
def resting_v(cell: int) -> float:
    """The voltage of a cell without load."""
    return 3.6 + 0.15 * sin(1.7 * cell) + 0.01 * ((cell * 7) % 11)


@dataclass
class Peer:
    """A battery that speaks; voltages and temperatures are true at any time."""

    name: str
    n_cells: int
    n_sensors: int
    profile: str = ""  # TOML of [source], to decode it
    positive: str = "discharge"  # sign of the current on the wire
    segments: tuple[int, ...] | None = None  # where names tell them
    sent: list[Sent] = field(default_factory=list)
    resolution_v: float = 0.0001
    _packed: dict[tuple[float, ...], list[tuple[int, int, bytes]]] = field(default_factory=dict, repr=False)

    def voltage(self, cell: int, t: float) -> float:
        return resting_v(cell) - OHM * self.current(t)

    def temperature(self, sensor: int, t: float) -> float:
        return 22.0 + (sensor * 5) % 17 + 0.02 * t

    def current(self, t: float) -> float:
        """Positive on discharge: a drive in steps, now and then recuperation."""
        return float((0, 60, 120, 30, -25, 90, 10, 150, -40, 5)[int(t / 1.3) % 10])

    def pack_voltage(self, t: float) -> float:
        return sum(map(resting_v, range(self.n_cells))) - self.n_cells * OHM * self.current(t)

    def dbc(self) -> str:
        return HEAD + "".join(each.lines() for each in self.sent)

    def frames(self, duration_s: float) -> list[tuple[int, int, bytes]]:
        key = duration_s, *map(id, self.sent)  # packing is slow, and tests ask again
        if key not in self._packed:
            found = [each for sent in self.sent for each in _frames(sent, duration_s)]
            self._packed[key] = sorted(found, key=lambda frame: frame[0])
        return self._packed[key]


def _frames(sent: Sent, duration_s: float) -> Iterator[tuple[int, int, bytes]]:
    gap_s = sent.period_s / len(sent.turns)
    for k in range(int(duration_s / gap_s)):
        t = k * gap_s + (sent.can_id % 97) * 1e-5
        whole = 0
        for bits in sent.turns[k % len(sent.turns)]:
            whole |= bits.packed(t, sent.size)
        yield round(t * 1e9), sent.can_id, sent.fix(sent.can_id, whole.to_bytes(sent.size, "little"))


def fixed(value: float) -> Value:
    return lambda _t: value


def others(peer: Peer, names: dict[str, str] | None = None) -> list[Sent]:
    """What else is on a bus: the pack's own figures, and things that could be taken for cells."""
    n = {"pack": "BMS_PackStatus", "u": "Pack_Voltage", "i": "Pack_Current", "soc": "Pack_SOC"} | (names or {})
    sign = 1 if peer.positive == "discharge" else -1
    status = [
        Bits(n["u"], 0, 16, peer.pack_voltage, 0.1, unit="V"),
        Bits(n["i"], 16, 16, lambda t: sign * peer.current(t), 0.1, unit="A", signed=True),
        Bits(n["soc"], 32, 8, fixed(64), 0.5, unit="%"),
        Bits("Max_Cell_Temp", 40, 8, fixed(39), 1, -40, "degC"),
    ]
    cells = [
        Bits("Min_Cell_Voltage", 0, 16, lambda t: peer.voltage(3, t), 0.0001, unit="V"),
        Bits("Max_Cell_Voltage", 16, 16, lambda t: peer.voltage(1, t), 0.0001, unit="V"),
        Bits("Avg_Cell_Voltage", 32, 16, lambda t: 3.6, 0.0001, unit="V"),
        Bits("Min_Cell_Voltage_ID", 48, 8, fixed(3)),
        Bits("Max_Cell_Voltage_ID", 56, 8, fixed(1)),
    ]
    limits = [
        Bits("Cell_OverVoltage_Threshold", 0, 16, fixed(4.2), 0.001, unit="V"),
        Bits("Cell_UnderVoltage_Threshold", 16, 16, fixed(2.8), 0.001, unit="V"),
        Bits("Discharge_Current_Limit", 32, 16, fixed(300), 0.1, unit="A"),
    ]
    balancing = [Bits(f"Balancing_Cell_{k + 1}", k, 1, fixed(k % 3 == 0)) for k in range(min(peer.n_cells, 64))]
    motor = [
        Bits("MC_DC_Bus_Voltage", 0, 16, lambda t: peer.pack_voltage(t) * 0.98, 0.1, unit="V", signed=True),
        Bits("MC_Phase_A_Current", 16, 16, lambda t: 40 * sin(9 * t), 0.1, unit="A", signed=True),
        Bits("MC_Phase_B_Current", 32, 16, lambda t: 40 * sin(9 * t + 2), 0.1, unit="A", signed=True),
        Bits("MC_DC_Bus_Current", 48, 16, lambda t: peer.current(t) * 0.9, 0.1, unit="A", signed=True),
    ]
    heat = [Bits(f"Motor_Temp_{k + 1}", 16 * k, 16, fixed(55 + k), 0.1, unit="degC") for k in range(4)]
    low = [
        Bits(f"LV_Rail_{k + 1}_Voltage", 16 * k, 16, fixed((3.3, 5.0, 12.1, 3.3)[k]), 0.001, unit="V") for k in range(4)
    ]
    return [
        Sent(0x5A0, n["pack"], 8, 0.1, [status]),
        Sent(0x5A1, "BMS_CellStats", 8, 0.1, [cells]),
        Sent(0x5A2, "BMS_Limits", 8, 1.0, [limits]),
        Sent(0x5A3, "BMS_Balancing", 8, 1.0, [balancing]),
        Sent(0x5B0, "MC_Electrical", 8, 0.05, [motor]),
        Sent(0x5B1, "MC_Temps", 8, 0.5, [heat]),
        Sent(0x5B2, "VCU_Rails", 8, 0.5, [low]),
    ]
