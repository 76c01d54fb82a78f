"""A cell in few numbers: what each does to a voltage, and that tables, file and reports keep it."""

from dataclasses import replace

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import format_cell, parse_cell
from app.estimation.cell_model.circuit import CellModel
from app.estimation.cell_model.evidence import Evidence
from app.estimation.cell_model.ocv import OcvCurve
from app.estimation.cell_model.surface import TABLE_DEGC, Lag, SurfaceModel
from app.estimation.errors import CellFileError, ModelError

SOC = np.linspace(0.0, 1.0, 101)
NUMBERS = SurfaceModel(
    r0_ohm=0.02,
    r0_j_mol=18e3,
    kinetics_v=0.05,
    kinetics_a=3.0,
    kinetics_j_mol=35e3,
    low_exponent=0.6,
    high_exponent=0.4,
    diffusion_j_mol=27e3,
    lag_j_mol=25e3,
    lags=(Lag(30.0, 0.004, 0.005), Lag(600.0, 0.01, 0.0)),
    correction_soc=(0.0, 0.5, 1.0),
    correction=(1.2, 1.0, 0.9),
    entropy_soc=(0.0, 1.0),
    entropy_v_k=(1e-4, 3e-4),
    entropy_degc=(0.0, 40.0),
)


def cell(numbers=NUMBERS, **more):
    ocv = OcvCurve(SOC, 3.0 + SOC - 0.4 * np.exp(-SOC / 0.05))
    return CellModel("few", 3.0, ocv, surface=numbers, **numbers.tables(), **more)


def voltage_by_equation(model, z, lagged_a, i, degc):
    """The textbook's equation, for one cell."""
    n, T = model.surface, degc + 273.15
    f = {
        name: np.exp(getattr(n, name) / 8.314462618 * (1.0 / T - 1.0 / 298.15))
        for name in ("r0_j_mol", "kinetics_j_mol", "diffusion_j_mol", "lag_j_mol")
    }
    z_s = z - f["diffusion_j_mol"] * sum(lag.soc_per_a * i_k for lag, i_k in zip(n.lags, lagged_a, strict=True))
    share = (2 * z_s) ** n.low_exponent * (2 - 2 * z_s) ** n.high_exponent
    share *= np.exp(np.interp(z_s, n.correction_soc, np.log(n.correction)))
    entropy = np.interp(z_s, n.entropy_soc, n.entropy_v_k) * (np.clip(degc, *n.entropy_degc) - 25.0)
    lagged = f["lag_j_mol"] * sum(lag.r_ohm * i_k for lag, i_k in zip(n.lags, lagged_a, strict=True))
    over = n.kinetics_v * T / 298.15 * np.arcsinh(f["kinetics_j_mol"] * i / (n.kinetics_a * share))
    return float(model.ocv.voltage(z_s)) + entropy - f["r0_j_mol"] * n.r0_ohm * i - lagged - over


@pytest.mark.parametrize("degc", [-10.0, 0.0, 12.0, 25.0, 45.0])
@pytest.mark.parametrize(("z", "i"), [(0.2, 6.0), (0.5, 0.0), (0.5, -3.0), (0.8, 9.0)])
def test_tables_say_what_the_equation_says(z, i, degc):
    model = cell()
    lagged_a = np.array([0.8 * i, 0.4 * i])
    expected = voltage_by_equation(model, z, lagged_a, i, degc)
    assert float(model.terminal_voltage(z, lagged_a, i, degc)) == pytest.approx(
        expected, abs=0.02 * abs(3.9 - expected)
    )


def test_a_surface_emptier_than_the_mean_lowers_the_voltage_where_the_curve_is_steep():
    model = cell()
    drops = model.drop_v(np.array([0.08, 0.6]), np.full((2, 2), 6.0), 0.0)
    assert drops[0] > 2.0 * drops[1] > 0.0


def test_the_cold_slows_all_down():
    model = cell()
    cold, warm = model.lasting_ohm([0.0, 25.0])
    assert cold > 1.5 * warm


def test_a_cell_that_resists_twice_drops_about_twice():
    model = cell()
    one, two = (float(model.drop_v(0.6, [3.0, 3.0], 3.0, 25.0, factor)) for factor in (1.0, 2.0))
    assert two == pytest.approx(2.0 * one, rel=0.02)


def test_a_file_holds_the_numbers_alone_and_fits_a_page():
    evidence = Evidence(
        has_ocv=True,
        soc=(0.1, 1.0),
        lowest=((0.0, 0.2), (25.0, 0.05)),
        sigma=(("kinetics_v", 0.1), ("r0_ohm", 0.02)),
        by_degc=((25.0, 0.004),),
        by_soc=((0.5, 0.003),),
    )
    model = cell(evidence=evidence)
    text = format_cell(model)
    again = parse_cell(text)
    assert text.count("\n") < 60
    assert "[circuit]" not in text
    assert again.surface == model.surface
    assert again.evidence == evidence
    degc = np.array([-20.0, 7.0, 55.0])
    np.testing.assert_allclose(
        again.terminal_voltage(0.3, np.ones((2, 3)), 4.0, degc), model.terminal_voltage(0.3, np.ones((2, 3)), 4.0, degc)
    )


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ("kinetics_a = 3.0", "kinetics_a = 0.0", "surface.kinetics_a"),
        ("low_exponent = 0.6", "low_exponent = 9.0", "surface.low_exponent"),
        ("correction = [1.2, 1.0, 0.9]", "correction = [1.2, 1.0]", "surface.correction"),
        ("tau_s = 30.0", "tau_s = -1.0", "surface.lag[0]"),
        ("r0_ohm = 0.02", "", "surface.r0_ohm"),
        ("[surface]", "[circuit]\nr0_ohm = 0.1\n\n[surface]", "circuit"),
    ],
)
def test_a_number_that_cannot_be_is_refused_by_name(old, new, field):
    text = format_cell(cell())
    assert old in text
    with pytest.raises(CellFileError) as caught:
        parse_cell(text.replace(old, new))
    assert caught.value.field == field


def test_the_lowest_soc_seen_holds_where_it_is_warmer_and_grows_where_it_is_colder():
    model = cell(evidence=Evidence(lowest=((0.0, 0.2), (25.0, 0.05))))
    np.testing.assert_allclose(model.lowest_soc([0.0, 12.5, 25.0, 60.0]), [0.2, 0.125, 0.05, 0.05])
    colder = model.lowest_soc([-10.0, -40.0, -60.0])
    assert 0.2 < colder[0] < colder[1] <= colder[2] <= 1.0
    assert (cell().lowest_soc([-10.0, 25.0]) < 0.0).all(), "nothing is known of it"


def test_where_nothing_measured_the_ocv_no_filter_is_valid():
    model = cell(evidence=Evidence(has_ocv=False))
    assert (model.drop_error([0.0, 25.0]) == 1.0).all()


def test_tables_of_the_surface_come_together_and_fit():
    model = cell()
    with pytest.raises(ModelError, match="surface_per_a"):
        replace(model, reference_a=None)
    with pytest.raises(ModelError, match="surface_per_a"):
        replace(model, surface_per_a=np.zeros((2, TABLE_DEGC.size - 1)))
    with pytest.raises(ModelError, match="reference_a"):
        replace(model, reference_a=-model.reference_a)
