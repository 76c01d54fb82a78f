"""Slave boards that are lost, and cells that were only not told yet."""

from types import SimpleNamespace

import numpy as np
import pytest

from app.analysis.root_cause.boards import board_suspicions


def recording(voltage_v, tells_at_once):
    rows = len(voltage_v)
    nothing = np.zeros((0, 2))
    return SimpleNamespace(
        time_s=np.arange(rows, dtype=float),
        voltage_v=voltage_v,
        pack_starts=np.array([0, 3]),
        events=(),
        tells_at_once=tells_at_once,
        boards=SimpleNamespace(time_s=np.zeros(0), damaged=nothing, failed_tests=nothing),
    )


def lost(voltage_v, tells_at_once):
    return [each.pack for each in board_suspicions(recording(voltage_v, tells_at_once))]


@pytest.mark.parametrize(("tells_at_once", "expected"), [(False, []), (True, [1])])
def test_a_pack_whose_turn_comes_late_in_the_first_round_is_not_lost(tells_at_once, expected):
    volts = np.full((30, 6), 3.7)
    volts[:8, 3:] = np.nan
    assert lost(volts, tells_at_once) == expected


@pytest.mark.parametrize("tells_at_once", [False, True])
@pytest.mark.parametrize("rows", [slice(10, 20), slice(None)])
def test_a_pack_that_falls_silent_or_never_spoke_is_lost(tells_at_once, rows):
    volts = np.full((30, 6), 3.7)
    volts[rows, 3:] = np.nan
    assert lost(volts, tells_at_once) == [1]
