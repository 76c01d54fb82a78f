"""Calibration of the current sensor: what it says on average, and the gain or offset that makes it say the truth.

    i[10 mA] = (10 count - i_offset) i_gain / 5000

Nothing is written here: a proposal becomes a draft of the configuration, and goes the way of every other.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from app.errors import ConfigError, NotNow
from app.sources.master.client import MasterClient, read_field
from app.words import Message, Quantity
from firmware_protocol.memory_map import CONFIG, FIELDS, STATUS_FLAGS

SAMPLES = 20
PERIOD_S = 0.05
MIN_REFERENCE_A = 5.0  # below it the sensor's noise is more than a percent
MAX_CORRECTION = 0.2  # relative change of the gain; more means another fault
MAX_OFFSET_COUNTS = 1000.0  # tenths of an ADC count, 24 A with the default gain
STEADY_A = 2.0


@dataclass(frozen=True, slots=True)
class Measured:
    """The current by the master, averaged [A]; positive on discharge."""

    mean_a: float
    sigma_a: float
    samples: int
    relays_closed: bool


@dataclass(frozen=True, slots=True)
class Proposal:
    """A proposed change, in raw counts, and the same reading with it [A]."""

    field: Literal["i_offset", "i_gain"]
    before_raw: int
    after_raw: int
    before_a: float
    after_a: float


def measure(master: MasterClient, *, sleep: Callable[[float], None] = time.sleep) -> Measured:
    """Average the master's latest sample over a second.

    Raises:
        LinkError: the master cannot be asked.
    """
    values = []
    for _ in range(SAMPLES):
        (raw,) = read_field(master, "i_fs")
        values.append(raw * FIELDS["i_fs"].scale)
        sleep(PERIOD_S)
    (bits,) = read_field(master, "status.flags")
    mean_a = sum(values) / len(values)
    sigma_a = math.sqrt(sum((value - mean_a) ** 2 for value in values) / (len(values) - 1))
    return Measured(mean_a, sigma_a, len(values), bool(bits >> STATUS_FLAGS.index("load") & 1))


def propose_zero(image: bytes, measured: Measured) -> Proposal:
    """Return the offset with which a sensor without current reads 0.

    Raises:
        NotNow: a current may flow, or the reading is not steady.
        ConfigError: the sensor is further off than a working one can be.
    """
    if measured.relays_closed:
        raise NotNow(Message("zero-with-relays-open"))
    _require_steady(measured)
    gain, offset = _of(image)
    after = round(offset + measured.mean_a * 100 * 5000 / gain)
    if abs(after - offset) > MAX_OFFSET_COUNTS:
        most_a = MAX_OFFSET_COUNTS * gain / 5000 / 100
        limit = Message("too-far-from-zero", most=Quantity(most_a, "A", 0))
        raise ConfigError("current", f"{measured.mean_a:.2f} A", limit)
    residue_a = measured.mean_a - (after - offset) * gain / 5000 / 100
    return Proposal("i_offset", offset, after, measured.mean_a, residue_a)


def propose_gain(image: bytes, measured: Measured, reference_a: float) -> Proposal:
    """Return the gain with which the reading is a reference meter's; the zero has to be right before.

    Raises:
        NotNow: the reading is not steady.
        ConfigError: the reference is too small, or too far from the reading.
    """
    if not abs(reference_a) >= MIN_REFERENCE_A:
        raise ConfigError(
            "reference_a", reference_a, Message("at-least-either-way", least=Quantity(MIN_REFERENCE_A, "A"))
        )
    _require_steady(measured)
    ratio = reference_a / measured.mean_a if measured.mean_a else math.inf
    if not abs(ratio - 1) <= MAX_CORRECTION:
        reading = Quantity(measured.mean_a, "A", 2)
        limit = Message("too-far-from-reading", percent=round(MAX_CORRECTION * 100), reading=reading)
        raise ConfigError("reference_a", reference_a, limit)
    gain, _ = _of(image)
    after = round(gain * ratio)
    return Proposal("i_gain", gain, after, measured.mean_a, measured.mean_a * after / gain)


def _require_steady(measured: Measured) -> None:
    if measured.sigma_a > STEADY_A:
        raise NotNow(Message("not-steady", sigma=Quantity(measured.sigma_a, "A", 1)))


def _of(image: bytes) -> tuple[int, int]:
    return CONFIG["i_gain"].unpack(image)[0], CONFIG["i_offset"].unpack(image)[0]
