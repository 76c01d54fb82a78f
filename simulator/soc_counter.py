"""The master's own state of charge: a Coulomb counter that starts from the voltage at rest.

The start table is what a firmware author reads off a data sheet: 21 points, no temperature, no hysteresis.
"""

import numpy as np

from simulator.memory import Config

OCV_V = np.array([
    2.660, 3.308, 3.406, 3.462, 3.504, 3.553, 3.600, 3.627, 3.652, 3.692, 3.742,
    3.790, 3.841, 3.884, 3.926, 3.975, 4.025, 4.058, 4.086, 4.136, 4.194,
])  # fmt: skip
OCV_SOC = np.linspace(0, 1, len(OCV_V))
AT_REST_COUNTS = 200  # 2 A [10 mA]
MAMS_PER_UAH = 3600  # mA ms in 1 uAh
SOC_SCALE = 10_000  # one count is 0.01 %


def soc_from_rest(cell_voltage_v: float) -> float:
    """Return the SOC (0..1) that belongs to a voltage at rest [V]."""
    return float(np.interp(cell_voltage_v, OCV_V, OCV_SOC))


class SocCounter:
    """Charge drawn since full, in uAh, counted from the means of the current, each for the `ts` samples it is of."""

    def __init__(self) -> None:
        self.dod_uah = 0.0
        self.is_started = False

    def start_from_rest(self, config: Config, v_avg: int, i_fc: int) -> None:
        """Start from the mean cell voltage [100 uV], if there is one and the current [10 mA] is that of rest."""
        if v_avg and abs(i_fc) < AT_REST_COUNTS:
            self.set_soc(config, soc_from_rest(v_avg * 1e-4))

    def restart(self, config: Config, v_avg: int, i_fc: int) -> bool:
        """Start again from the voltage at rest; False where there is none, or a current flows."""
        if not v_avg or abs(i_fc) >= AT_REST_COUNTS:
            return False
        self.start_from_rest(config, v_avg, i_fc)
        return True

    def start_from_journal(self, dod_uah: int) -> None:
        """Continue from a stored count."""
        self.dod_uah = float(dod_uah)
        self.is_started = True

    def set_soc(self, config: Config, soc: float) -> None:
        """Set the counter by a SOC (0..1)."""
        self.dod_uah = (1 - soc) * _capacity_uah(config)
        self.is_started = True

    def count(self, config: Config, i_fs: int) -> None:
        """Count one mean of `ts` samples of 1 ms [10 mA]."""
        drawn_uah = i_fs * 10 * config.ts / MAMS_PER_UAH
        self.dod_uah = min(max(self.dod_uah + drawn_uah, 0.0), _capacity_uah(config))

    def soc_counts(self, config: Config) -> int:
        """Return the SOC [0.01 %]; 0 before the start."""
        if not self.is_started:
            return 0
        return max(round((1 - self.dod_uah / _capacity_uah(config)) * SOC_SCALE), 0)


def _capacity_uah(config: Config) -> float:
    return config.c_avg * 10_000.0
