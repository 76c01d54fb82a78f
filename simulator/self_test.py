"""The LTC6804's self-tests: conversions whose result is known, so that a stuck bit of a converter shows.

The two patterns of a mode are complements: together they find every bit that is stuck. Source: the data sheet's
command and self-test tables.
"""

from typing import NamedTuple

from firmware_protocol.ltc6804 import AdcMode

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
