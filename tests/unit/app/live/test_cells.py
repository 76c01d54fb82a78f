"""Packs of segments that differ in size."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from app.battery.battery import Battery
from app.live.cells import packs_of, with_findings

BATTERY = Battery("uneven", (3, 1, 2))


def packs(voltage_v, temperature_degc):
    cells = SimpleNamespace(voltage_v=np.array(voltage_v), temperature_degc=np.array(temperature_degc))
    return packs_of(BATTERY, cells, (None,) * 3)


def test_each_pack_has_the_sum_and_extremes_of_its_own_cells():
    found = packs([3.0, 3.1, 3.2, 4.0, 3.5, 3.6], [20.0, 22.0, 21.0, 30.0, 25.0, 26.0])
    assert [pack.voltage_v for pack in found] == pytest.approx([9.3, 4.0, 7.1])
    assert [pack.delta_v for pack in found] == pytest.approx([0.2, 0.0, 0.1])
    assert [pack.temperature_max_degc for pack in found] == [22.0, 30.0, 26.0]


def test_a_pack_with_a_missing_cell_has_no_voltage_but_extremes_of_the_others():
    missing = float("nan")
    found = packs([missing, 3.1, 3.2, missing, 3.5, 3.6], [missing] * 6)
    assert [pack.voltage_v for pack in found] == [None, None, pytest.approx(7.1)]
    assert [pack.delta_v for pack in found] == [None, None, pytest.approx(0.1)]
    assert (found[0].min_v, found[1].min_v) == (3.1, None)
    assert found[2].temperature_max_degc is None


@dataclass
class Resistances:
    resistance_ohm: np.ndarray
    joint_excess_ohm: np.ndarray
    joint_loose: np.ndarray | None = None


@pytest.mark.parametrize(("code", "joint_ohm"), [("joint-resistance-high", 0.014), ("cell-resistance-high", 0.0)])
def test_a_cell_has_the_resistance_and_joint_of_the_verdict_on_its_trip(code, joint_ohm):
    measured = Resistances(np.array([0.002, 0.0021, 0.0019]), np.zeros(3))
    found = with_findings(measured, [SimpleNamespace(code=code, cell=2, size=0.014)])
    assert found.joint_excess_ohm == pytest.approx([0, 0, joint_ohm])
    assert found.resistance_ohm == pytest.approx([0.002, 0.0021, 0.016])
    assert measured.resistance_ohm[2] == 0.0019
    assert list(found.joint_loose) == [False, False, joint_ohm > 0]
