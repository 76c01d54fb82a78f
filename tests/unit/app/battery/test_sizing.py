"""What a battery of given cells can do: against the key data of the SOC thesis, and a plain circuit."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.battery.sizing import CellLayout, figures_of
from app.estimation.cell_model.cell_file import load_cell
from app.estimation.cell_model.circuit import CellLimits, CellModel
from app.estimation.cell_model.ocv import OcvCurve

MODULE = load_cell("samsung-25r-10p")
TEAM = CellLayout(8, 12)


def straight(**changes):
    """A cell whose OCV is 3 V + SOC, with 10 mohm, and 5 mohm more after a while."""
    values = {
        "name": "straight",
        "capacity_ah": 2.0,
        "ocv": OcvCurve(np.array([0.0, 0.5, 1.0]), np.array([3.0, 3.5, 4.0])),
        "soc_grid": np.array([0.5]),
        "temperature_grid_degc": np.array([25.0]),
        "r0_ohm": np.array([[0.010]]),
        "r_ohm": np.array([[[0.005]]]),
        "tau_s": np.array([[[10.0]]]),
        "v_min_v": 2.8,
        "v_max_v": 4.2,
        "v_nominal_v": 3.5,
        "mass_kg": 0.05,
        "limits": CellLimits(discharge_max_a=20.0, charge_max_a=4.0),
    }
    return CellModel(**(values | changes))


PRINTED = {  # SPKF-2020, Tables 1 to 3: what is right there, of cell, segment and accumulator
    "voltage_max_v": (4.2, 50.4, 403.2),
    "voltage_nominal_v": (3.6, 43.2, 345.6),
    "voltage_min_v": (2.5, 30.0, 240.0),
    "capacity_ah": (2.5, 25.0, 25.0),
}


@pytest.mark.parametrize("name", PRINTED)
def test_voltages_and_capacity_are_those_that_the_thesis_prints(name):
    figure, (cell, segment, battery) = figures_of(MODULE, TEAM)[name], PRINTED[name]
    per_module = 10 * cell if name == "capacity_ah" else cell
    assert (figure.cell, figure.segment, figure.battery) == pytest.approx((per_module, segment, battery))


def test_the_thesis_prints_watt_hours_of_the_highest_voltage_as_joules():
    figures = figures_of(MODULE, TEAM)
    capacity, highest = figures["capacity_ah"], figures["voltage_max_v"]
    assert highest.cell * capacity.cell / 10.0 == pytest.approx(10.5)  # Table 1: "10.5 kJ"
    assert highest.segment * capacity.segment / 1e3 == pytest.approx(1.26)  # Table 2: "1.26 MJ"
    assert highest.battery * capacity.battery / 1e3 == pytest.approx(10.08)  # Table 3: "10.08 MJ"
    assert figures["energy_nominal_mj"].battery == pytest.approx(345.6 * 25.0 * 3600.0 / 1e6)


def test_cells_weigh_what_table_one_says_and_less_than_the_segments_that_hold_them():
    mass = figures_of(MODULE, TEAM)["mass_kg"]
    assert mass.segment == pytest.approx(120 * 0.045)
    assert mass.segment < 7.40
    assert mass.battery < 59.2


def test_resistance_and_power_are_those_of_the_circuit():
    figures = figures_of(straight(), CellLayout(2, 3, 4), soc=0.5)
    assert figures["resistance_ohmic_mohm"].cell == pytest.approx(10.0)
    assert figures["resistance_10s_mohm"].cell == pytest.approx(10.0 + 5.0 * (1.0 - np.exp(-1.0)))
    assert figures["resistance_settled_mohm"].cell == pytest.approx(15.0)
    assert figures["resistance_settled_mohm"].battery == pytest.approx(15.0 * 6 / 4)
    assert figures["discharge_power_continuous_kw"].battery == pytest.approx(24 * 20.0 * (3.5 - 0.3) / 1e3)
    assert figures["discharge_current_continuous_a"].battery == pytest.approx(4 * 20.0)
    assert figures["charge_power_continuous_kw"].cell == pytest.approx(4.0 * (3.5 + 0.06) / 1e3)
    drawn = 20.0 * 10.0 / 3600.0 / 2.0
    at_end_v = 3.5 - drawn - 20.0 * (0.010 + 0.005 * (1.0 - np.exp(-1.0)))
    assert figures["discharge_power_10s_kw"].cell == pytest.approx(20.0 * at_end_v / 1e3, rel=1e-3)
    assert "limits.discharge_max_a" in figures["discharge_power_10s_kw"].condition


def test_where_the_voltage_ends_it_the_current_is_less_and_the_condition_says_so():
    cell = straight(limits=CellLimits(discharge_max_a=200.0, charge_max_a=200.0))
    figures = figures_of(cell, CellLayout(1, 1), soc=0.5)
    assert figures["discharge_current_continuous_a"].cell == pytest.approx(0.7 / 0.015)
    assert figures["charge_current_continuous_a"].cell == pytest.approx(0.7 / 0.015)
    assert figures["discharge_current_10s_a"].cell > figures["discharge_current_continuous_a"].cell
    for name in ("discharge_power_continuous_kw", "discharge_power_10s_kw", "charge_power_10s_kw"):
        assert "limited by the voltage" in figures[name].condition


def test_what_the_cell_file_does_not_say_is_missing_by_its_name():
    cell = straight(v_nominal_v=None, mass_kg=None, limits=CellLimits(charge_max_a=4.0))
    figures = figures_of(cell, CellLayout(2, 3))
    missing = {name: figure.missing for name, figure in figures.items() if figure.missing}
    assert missing == {
        "voltage_nominal_v": ("v_nominal_v",),
        "energy_nominal_mj": ("v_nominal_v",),
        "mass_kg": ("mass_kg",),
        **dict.fromkeys(
            (f"discharge_{what}" for what in
             ("current_continuous_a", "power_continuous_kw", "current_10s_a", "power_10s_kw")),
            ("limits.discharge_max_a",),
        ),
    }  # fmt: skip
    assert all(figures[name].battery is None for name in missing)


def test_what_was_never_measured_is_called_extrapolated():
    cell = replace(straight(), fit_current_max_a=10.0)
    figures = figures_of(cell, CellLayout(1, 1), temperature_degc=5.0)
    assert "measured at 25 to 25 degC" in figures["resistance_10s_mohm"].condition
    assert "measured up to 10 A" in figures["discharge_power_10s_kw"].condition
    assert "measured up to" not in figures["charge_power_10s_kw"].condition


@given(st.integers(1, 30), st.integers(1, 30), st.integers(1, 40), st.floats(0.02, 0.98))
def test_a_battery_is_one_however_its_cells_are_counted(n_segments, n_in_series, n_parallel, soc):
    figures = figures_of(straight(), CellLayout(n_segments, n_in_series, n_parallel), soc)
    amps, volts = figures["discharge_current_continuous_a"].battery, figures["voltage_nominal_v"].battery
    assert figures["energy_nominal_mj"].battery == pytest.approx(volts * 2.0 * n_parallel * 3600.0 / 1e6)
    ohm = figures["resistance_settled_mohm"].battery / 1e3
    at_rest_v = n_segments * n_in_series * (3.0 + soc)
    held_kw = figures["discharge_power_continuous_kw"].battery
    assert held_kw == pytest.approx(amps * (at_rest_v - ohm * amps) / 1e3, rel=1e-6)
    assert all(figure.unit and figure.condition for figure in figures.values())
