"""Charge bled: in ampere hours where the resistor is stated, else it is not known."""

import numpy as np
import pytest

from app.analysis.survey import SurveyPiece
from app.season.lake.cell_sums import CellSums

TIME_S = np.arange(0.0, 60.1, 0.5)


def piece():
    shape = (len(TIME_S), 2)
    bleeds = np.zeros(shape)
    bleeds[:, 1] = 1.0
    return SurveyPiece(
        TIME_S, np.zeros(len(TIME_S)), np.full(shape, 4.0), np.full(shape, 25.0), np.full(shape, 0.5), bleeds
    )


@pytest.mark.parametrize(("ohm", "bled_ah"), [(20.0, [0.0, 4.0 / 20.0 * 60.0 / 3600.0]), (None, [np.nan, np.nan])])
def test_the_charge_bled_is_the_voltage_over_the_resistor(ohm, bled_ah):
    sums = CellSums(2, ohm)
    sums.add(piece(), {})
    columns = sums.columns()
    assert columns["bled_v_s"] == pytest.approx([0.0, 240.0])
    assert columns["bled_ah"] == pytest.approx(bled_ah, nan_ok=True)
