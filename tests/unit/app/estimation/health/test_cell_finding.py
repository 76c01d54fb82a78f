import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.estimation.health.cell_finding import SURE, CellFinding, confidence_of

NAN = float("nan")


def finding(size, sigma):
    return CellFinding("joint-resistance-high", 5, size, sigma, "ohm", 1.0, 2.0, 3.0, 50.0, 0.01, 0.002, (4, 6), 0.9)


def test_the_band_lies_around_the_size_and_never_below_nothing():
    assert finding(1.0, 0.1).band == pytest.approx((0.8, 1.2))
    assert finding(1.0, 2.0).band[0] == 0.0


@given(st.floats(-10, 10), st.floats(1e-3, 10), st.floats(0, 5))
def test_confidence_is_a_probability_that_grows_with_the_size(size, sigma, tolerated):
    confidence = confidence_of(size, sigma, tolerated)
    assert 0.0 <= confidence <= SURE
    assert confidence_of(size + 1.0, sigma, tolerated) >= confidence


@pytest.mark.parametrize(("size", "sigma"), [(NAN, 1.0), (1.0, 0.0), (1.0, NAN), (1.0, np.inf)])
def test_what_is_not_known_gives_no_confidence(size, sigma):
    assert confidence_of(size, sigma, 2.0) <= 0.5
