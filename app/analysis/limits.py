"""The limits of then: what a configuration image of the master says they are."""

from __future__ import annotations

from typing import Final

from firmware_protocol.memory_map import CONFIG

LIMITS: Final = ("v_cell_min", "v_cell_max", "t_cell_min", "t_cell_max", "i_disc_max", "i_disc_min")


def limits_of(image: bytes | None) -> dict[str, float]:
    """Return what the configuration limits, by name, in units; empty where no configuration was received."""
    if image is None:
        return {}
    return {name: round(CONFIG[name].unpack(image)[0] * CONFIG[name].scale, 6) for name in LIMITS}
