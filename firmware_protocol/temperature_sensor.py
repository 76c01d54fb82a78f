"""The temperature sensor inside an Energus module: volts to degC and back.

Source: the 33 points that Energus publishes, -40 to 120 degC in steps of 5 K. The curve falls: about 12 mV/K at
25 degC, but only 1 to 2 mV/K below -30 and above 100 degC. Linear between the points.
"""

import bisect

FIRST_DEGC = -40
STEP_DEGC = 5
# fmt: off
POINTS_V = (
    2.44, 2.42, 2.40, 2.38, 2.35, 2.32, 2.27, 2.23,  # -40 to -5 degC
    2.17, 2.11, 2.05, 1.99, 1.92, 1.86, 1.80, 1.74,  # 0 to 35
    1.68, 1.63, 1.59, 1.55, 1.51, 1.48, 1.45, 1.43,  # 40 to 75
    1.40, 1.38, 1.37, 1.35, 1.34, 1.33, 1.32, 1.31, 1.30,  # 80 to 120
)
# fmt: on
LAST_DEGC = FIRST_DEGC + STEP_DEGC * (len(POINTS_V) - 1)
MARGIN_V = 0.005  # half of the table's last digit
_RISING_V = POINTS_V[::-1]


def temperature_degc(voltage_v: float) -> float | None:
    """Return the temperature at a sensor voltage [degC], None where no working sensor gives that voltage."""
    if not _RISING_V[0] - MARGIN_V <= voltage_v <= _RISING_V[-1] + MARGIN_V:
        return None
    clamped_v = min(max(voltage_v, _RISING_V[0]), _RISING_V[-1])
    upper = min(max(bisect.bisect_left(_RISING_V, clamped_v), 1), len(_RISING_V) - 1)
    low_v, high_v = _RISING_V[upper - 1], _RISING_V[upper]
    return LAST_DEGC - STEP_DEGC * (upper - 1 + (clamped_v - low_v) / (high_v - low_v))


def sensor_voltage_v(temperature: float) -> float:
    """Return the sensor's voltage [V] at a temperature [degC]; beyond the table it stays at the last point."""
    position = min(max((temperature - FIRST_DEGC) / STEP_DEGC, 0.0), len(POINTS_V) - 1.0)
    index = min(int(position), len(POINTS_V) - 2)
    return POINTS_V[index] + (position - index) * (POINTS_V[index + 1] - POINTS_V[index])
