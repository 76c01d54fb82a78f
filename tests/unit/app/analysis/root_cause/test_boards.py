"""Slave boards that are lost, and cells that were only not told yet."""

from types import SimpleNamespace

import numpy as np
import pytest

from app.analysis.root_cause.links import board_hypotheses


def recording(voltage_v, is_together):
    rows = len(voltage_v)
    nothing = np.zeros((0, 2))
    return SimpleNamespace(
        time_s=np.arange(rows, dtype=float),
        voltage_v=voltage_v,
        pack_starts=np.array([0, 3]),
        events=(),
        is_together=is_together,
        boards=SimpleNamespace(time_s=np.zeros(0), damaged=nothing, failed_tests=nothing),
    )


def lost(voltage_v, is_together):
    return [each.pack for each in board_hypotheses(recording(voltage_v, is_together))]


@pytest.mark.parametrize(("is_together", "expected"), [(False, []), (True, [1])])
def test_a_pack_whose_turn_comes_late_in_the_first_round_is_not_lost(is_together, expected):
    volts = np.full((30, 6), 3.7)
    volts[:8, 3:] = np.nan
    assert lost(volts, is_together) == expected


@pytest.mark.parametrize("is_together", [False, True])
@pytest.mark.parametrize("rows", [slice(10, 20), slice(None)])
def test_a_pack_that_falls_silent_or_never_spoke_is_lost(is_together, rows):
    volts = np.full((30, 6), 3.7)
    volts[rows, 3:] = np.nan
    assert lost(volts, is_together) == [1]
