"""The fan curve: duty over the hottest cell's temperature."""

import math

from simulator.memory import Config

AUTOMATIC = -1


def ramp_duty(config: Config, t_max_degc: int) -> int:
    """Return the duty [1/255]: lowest up to `fan_ramp_start`, highest from `fan_ramp_stop` on, linear between."""
    if t_max_degc <= config.fan_ramp_start:
        return config.fan_ramp_min
    if t_max_degc >= config.fan_ramp_stop:
        return config.fan_ramp_max
    above, width = t_max_degc - config.fan_ramp_start, config.fan_ramp_stop - config.fan_ramp_start
    rise = config.fan_ramp_max - config.fan_ramp_min
    return config.fan_ramp_min + (2 * above * rise + width) // (2 * width)  # to the nearest, in whole numbers


class Fans:
    """The duty of the fans: from the ramp, or from a command."""

    def __init__(self) -> None:
        self.override = AUTOMATIC
        self._until_s = math.inf

    def command(self, argument: int, now_s: float) -> None:
        """Take the argument of FAN_OVERRIDE: a duty and for how many seconds, or AUTOMATIC."""
        self.override = AUTOMATIC if argument == AUTOMATIC else argument & 0xFF
        seconds = 0 if argument == AUTOMATIC else argument >> 8
        self._until_s = now_s + seconds if seconds else math.inf

    def duty(self, config: Config, t_max_degc: int, now_s: float) -> int:
        """Return the duty in force [1/255]."""
        if now_s >= self._until_s:
            self.override, self._until_s = AUTOMATIC, math.inf
        return ramp_duty(config, t_max_degc) if self.override == AUTOMATIC else self.override
