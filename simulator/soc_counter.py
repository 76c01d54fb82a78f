"""The master's own state of charge: a Coulomb counter that starts from the voltage at rest.

The start table is what a firmware author reads off a data sheet: 21 points, no temperature, no hysteresis.
"""

from bisect import bisect_right

import numpy as np

from firmware_protocol.memory_map import V_MISSING
from simulator.memory import Config

OCV_V = np.array([
    2.660, 3.308, 3.406, 3.462, 3.504, 3.553, 3.600, 3.627, 3.652, 3.692, 3.742,
    3.790, 3.841, 3.884, 3.926, 3.975, 4.025, 4.058, 4.086, 4.136, 4.194,
])  # fmt: skip
OCV_SOC = np.linspace(0, 1, len(OCV_V))
AT_REST_COUNTS = 200  # 2 A [10 mA]
PER_UAH = 360  # 10 mA for 1 ms, in 1 uAh
SOC_SCALE = 10_000  # one count is 0.01 %
_REST_COUNTS: list[int] = [round(volts * 1e4) for volts in OCV_V.tolist()]
_SOC_STEP = SOC_SCALE // (len(_REST_COUNTS) - 1)  # between two points


def soc_from_rest(cell_voltage_v: float) -> float:
    """Return the SOC (0..1) that belongs to a voltage at rest [V]."""
    return float(np.interp(cell_voltage_v, OCV_V, OCV_SOC))


def rest_soc_counts(v: int) -> int:
    """Return the SOC [0.01 %], rounded down, that belongs to a voltage at rest [100 uV]."""
    above = bisect_right(_REST_COUNTS, v)
    if not 0 < above < len(_REST_COUNTS):
        return SOC_SCALE if above else 0
    low, high = _REST_COUNTS[above - 1 : above + 1]
    return (above - 1) * _SOC_STEP + (v - low) * _SOC_STEP // (high - low)


class SocCounter:
    """Charge drawn since full, counted from the means of the current, each for the `ts` samples it is of.

    In whole numbers, as a microcontroller counts: of 10 mA for 1 ms, 360 of which are 1 uAh.
    """

    def __init__(self) -> None:
        self._drawn = 0
        self.is_started = False

    @property
    def dod_uah(self) -> int:
        """The charge drawn since full [uAh]."""
        return self._drawn // PER_UAH

    def start_from_rest(self, config: Config, v_avg: int, i_fc: int) -> bool:
        """Start, also anew, from the mean cell voltage [100 uV]; False without one, or with a current [10 mA]."""
        is_at_rest = v_avg != V_MISSING and abs(i_fc) < AT_REST_COUNTS
        if is_at_rest:
            self.set_soc(config, rest_soc_counts(v_avg))
        return is_at_rest

    def start_from_journal(self, dod_uah: int) -> None:
        """Continue from a stored count."""
        self._drawn = dod_uah * PER_UAH
        self.is_started = True

    def set_soc(self, config: Config, soc: int) -> None:
        """Set the counter by a SOC [0.01 %]."""
        self.start_from_journal((SOC_SCALE - soc) * config.c_avg)

    def count(self, config: Config, i_fs: int) -> None:
        """Count one mean of `ts` samples of 1 ms [10 mA]."""
        full = config.c_avg * SOC_SCALE * PER_UAH
        self._drawn = min(max(self._drawn + i_fs * config.ts, 0), full)

    def soc_counts(self, config: Config) -> int:
        """Return the SOC [0.01 %]; 0 before the start."""
        # a count of `c_avg` is 10 mAh: 0.01 % of the capacity are as many uAh
        return max(SOC_SCALE - self.dod_uah // config.c_avg, 0) if self.is_started else 0
