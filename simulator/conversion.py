"""The conversions of an LTC6804, and how long each takes.

Times are those of the data sheet for one and for six conversions; those between lie on a line, as its own do.
"""

import functools
from typing import NamedTuple

from firmware_protocol.ltc6804 import AdcMode, Command
from firmware_protocol.memory_map import CELLS_PER_PACK

CVST = 0x207  # cells
AXST = 0x407  # GPIO and reference
STATST = 0x40F  # sum, die, supplies
PATTERNS = (1, 2)
_MODE_SHIFT, _PATTERN_SHIFT = 7, 5
_KIND_MASK = 0x61F  # what is neither mode nor pattern
_CODES = {1: 0x9555, 2: 0x6AAA}
_FAST_CODES = {1: 0x9565, 2: 0x6A9A}
_FAST_OPTION_CODES = {1: 0x9553, 2: 0x6AAC}  # 14 kHz: fast mode with CFGR's adcopt set


class SelfTest(NamedTuple):
    """One self-test command."""

    kind: int  # CVST, AXST or STATST
    mode: AdcMode
    pattern: int  # 1 or 2

    @property
    def command(self) -> int:
        """The command's 11 bits."""
        return self.kind | self.mode << _MODE_SHIFT | self.pattern << _PATTERN_SHIFT

    def code(self, *, adc_option: bool = False) -> int:
        """Return what every register of a sound chip holds afterwards."""
        if self.mode != AdcMode.FAST:
            return _CODES[self.pattern]
        return (_FAST_OPTION_CODES if adc_option else _FAST_CODES)[self.pattern]


def decode_self_test(command: int) -> SelfTest | None:
    """Return the self-test that a command asks for, None where it is another command."""
    kind, mode, pattern = command & _KIND_MASK, command >> _MODE_SHIFT & 3, command >> _PATTERN_SHIFT & 3
    if kind not in (CVST, AXST, STATST) or pattern not in PATTERNS or mode == 0:
        return None
    return SelfTest(kind, AdcMode(mode), pattern)


ADCV = 0x260
ADOW = 0x228
ADAX = 0x460
ADSTAT = 0x468
N_AUXILIARY = 6  # five GPIO and the second reference
N_STATUS = 4  # sum of cells, die, two supplies
DIAGNOSIS_S = 400e-6
REFERENCE_START_S = 4.4e-3  # besides the conversion, where CFGR's refon was not set long enough ago
_MODE_BITS = 0x180
_CHANNEL_BITS = 0x007
_PULL_UP = 0x040
_DISCHARGE_PERMITTED = 0x010
_CELL_PAIRS = CELLS_PER_PACK // 2
_ONE_AND_SIX_US = {  # by mode and CFGR's adcopt
    (AdcMode.FAST, False): (201, 1113),
    (AdcMode.FAST, True): (230, 1288),
    (AdcMode.NORMAL, False): (405, 2335),
    (AdcMode.NORMAL, True): (521, 3033),
    (AdcMode.FILTERED, False): (33568, 201317),
    (AdcMode.FILTERED, True): (754, 4430),
}


class Conversion(NamedTuple):
    """One conversion command, taken apart."""

    kind: int  # ADCV, ADOW, ADAX, ADSTAT or DIAGN; a self-test has the kind whose registers it fills
    mode: AdcMode
    columns: slice  # columns of the kind's registers
    times_s: tuple[float, float]  # duration with the reference up, by the chip's adcopt
    discharge_permitted: bool = False
    pull_up: bool = False
    self_test: SelfTest | None = None

    def time_s(self, *, adc_option: bool = False) -> float:
        """Return how long a chip with its reference up takes [s]."""
        return self.times_s[adc_option]


def _times_s(mode: AdcMode, n: int) -> tuple[float, float]:
    """Return the times of n conversions one after the other, by adcopt [s]."""
    without, with_option = (
        (one_us + (n - 1) * (six_us - one_us) / (_CELL_PAIRS - 1)) * 1e-6
        for one_us, six_us in (_ONE_AND_SIX_US[mode, option] for option in (False, True))
    )
    return without, with_option


@functools.lru_cache(maxsize=256)
def decode_conversion(command: int) -> Conversion | None:
    """Return what a command converts, None where it is another command or none that the chip knows."""
    if command == Command.DIAGN:
        return Conversion(Command.DIAGN, AdcMode.NORMAL, slice(0), (DIAGNOSIS_S, DIAGNOSIS_S))
    if (test := decode_self_test(command)) is not None:
        kind, n = {CVST: (ADCV, _CELL_PAIRS), AXST: (ADAX, N_AUXILIARY)}.get(test.kind, (ADSTAT, N_STATUS))
        return Conversion(kind, test.mode, slice(None), _times_s(test.mode, n), self_test=test)
    mode, channel = command >> 7 & 3, command & _CHANNEL_BITS
    kind = command & ~(_MODE_BITS | _CHANNEL_BITS)
    permitted = bool(kind & _DISCHARGE_PERMITTED)
    if kind & ~_DISCHARGE_PERMITTED == ADCV:
        base, pull_up, n_channels, period = ADCV, False, _CELL_PAIRS, _CELL_PAIRS
    elif kind & ~(_DISCHARGE_PERMITTED | _PULL_UP) == ADOW:
        base, pull_up, n_channels, period = ADOW, bool(kind & _PULL_UP), _CELL_PAIRS, _CELL_PAIRS
    elif kind in (ADAX, ADSTAT):
        n_channels = N_AUXILIARY if kind == ADAX else N_STATUS
        base, pull_up, period = kind, False, n_channels
    else:
        return None
    if mode == 0 or channel > n_channels:
        return None
    columns = slice(channel - 1, None if period == _CELL_PAIRS else channel, period) if channel else slice(None)
    times_s = _times_s(AdcMode(mode), 1 if channel else n_channels)
    return Conversion(base, AdcMode(mode), columns, times_s, permitted, pull_up)
