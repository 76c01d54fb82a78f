"""The fan curve: duty over the hottest cell's temperature."""

from simulator.memory import Config

AUTOMATIC = -1


def ramp_duty(config: Config, t_max_degc: int) -> int:
    """Return the duty [1/255]: lowest up to `fan_ramp_start`, highest from `fan_ramp_stop` on, linear between."""
    if t_max_degc <= config.fan_ramp_start:
        return config.fan_ramp_min
    if t_max_degc >= config.fan_ramp_stop:
        return config.fan_ramp_max
    share = (t_max_degc - config.fan_ramp_start) / (config.fan_ramp_stop - config.fan_ramp_start)
    return round(config.fan_ramp_min + share * (config.fan_ramp_max - config.fan_ramp_min))


class Fans:
    """The fans' duty: the ramp's, or the one that a command asked for."""

    def __init__(self) -> None:
        self.override = AUTOMATIC

    def duty(self, config: Config, t_max_degc: int) -> int:
        """Return the duty in force [1/255]."""
        return ramp_duty(config, t_max_degc) if self.override == AUTOMATIC else self.override
