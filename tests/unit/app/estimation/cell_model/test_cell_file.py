from dataclasses import replace

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import (
    DEFAULT_CELL,
    bundled_cells,
    format_cell,
    load_cell,
    parse_cell,
    save_cell,
)
from app.estimation.errors import CellFileError

GOOD = """name = "bench"
capacity_ah = 2.5
v_min_v = 2.5
v_max_v = 4.2

[ocv]
soc = [0.0, 0.5, 1.0]
voltage_v = [3.0, 3.6, 4.2]

[circuit]
soc = [0.0, 1.0]
temperature_degc = [10.0, 30.0]
r0_ohm = [[0.03, 0.02], [0.02, 0.01]]

[[circuit.rc]]
r_ohm = [0.01, 0.02]
tau_s = 10.0
"""


@pytest.mark.parametrize("name", bundled_cells())
def test_bundled_cells_load_and_name_their_source(name):
    model = load_cell(name)
    assert len(model.source) > 20
    assert model.ocv.voltage(0.0) < model.ocv.voltage(1.0) <= model.v_max_v + 0.05
    drop_v = model.ocv.voltage(0.5) - model.terminal_voltage(0.5, np.zeros(model.n_rc), model.c_rate_a, 25.0)
    assert 0.0 < drop_v < 0.3


def test_the_default_is_the_ten_parallel_module():
    model = load_cell()
    assert DEFAULT_CELL in bundled_cells()
    assert model.capacity_ah == 25.0
    assert 2e-3 < model.parameters(0.5, 25.0)[0] < 3e-3


def test_numbers_rows_and_tables_all_fill_the_grid():
    model = parse_cell(GOOD)
    assert model.tau_s.tolist() == [[[10.0, 10.0], [10.0, 10.0]]]
    assert model.r_ohm.tolist() == [[[0.01, 0.02], [0.01, 0.02]]]
    assert model.parameters(0.0, 30.0)[0] == pytest.approx(0.02)


def test_what_is_saved_is_what_is_loaded(tmp_path):
    model = replace(
        parse_cell(GOOD),
        name='quoted "name"\\',
        v_nominal_v=3.7,
        mass_kg=0.045,
        hysteresis_v=0.01,
        overpotential_v=np.full((2, 2), 0.005),
        overpotential_current_a=2.5,
        fit_voltage_rms_v=0.004,
        fit_temperature_degc=[12.0, 25.0],
        activation_sigma_j_mol=6e3,
        ocv_shift_v=[[-0.01, -0.02], [0.0, 0.0]],
    )
    path = tmp_path / "cell.toml"
    save_cell(model, path)
    again = load_cell(path)
    assert format_cell(again) == format_cell(model)
    assert again.name == model.name
    assert (again.v_nominal_v, again.mass_kg) == (3.7, 0.045)
    np.testing.assert_allclose(
        again.terminal_voltage(0.3, [1.0], 4.0, 22.0, -0.5), model.terminal_voltage(0.3, [1.0], 4.0, 22.0, -0.5)
    )
    np.testing.assert_allclose(again.drop_error([0.0, 18.0, 30.0]), model.drop_error([0.0, 18.0, 30.0]))


def test_a_file_of_an_earlier_version_vouches_for_the_temperatures_of_its_tables():
    model = parse_cell(GOOD)
    assert model.fit_temperature_degc is None
    assert model.drop_error(10.0) == model.drop_error(30.0) == 0.0
    assert model.drop_error(0.0) > 0.0
    assert "temperature_degc = [10.0, 30.0]" in format_cell(model)
    assert "[fit]\nvoltage_rms_v = 0.0\ncurrent_max_a = 0.0\nactivation" in format_cell(model)


@pytest.mark.parametrize(
    ("old", "new", "line", "field"),
    [
        ("capacity_ah = 2.5", 'capacity_ah = "big"', 2, "capacity_ah"),
        ("capacity_ah = 2.5", "capacity_ah = -1", 2, "capacity_ah"),
        ("capacity_ah = 2.5\n", "", None, "capacity_ah"),
        ("v_max_v = 4.2", "v_max_v = true", 4, "v_max_v"),
        ("voltage_v = [3.0, 3.6, 4.2]", "voltage_v = [3.0, 3.6]", 8, "ocv.voltage_v"),
        ("soc = [0.0, 0.5, 1.0]", 'soc = [0.0, "x", 1.0]', 7, "ocv.soc"),
        ("[ocv]", '[ocv]\nmethod = "spline"', 7, "ocv.method"),
        ("r0_ohm = [[0.03, 0.02], [0.02, 0.01]]", "r0_ohm = [[0.03, 0.02, 1], [0.02, 0.01, 1]]", 13, "circuit.r0_ohm"),
        ("r0_ohm = [[0.03, 0.02], [0.02, 0.01]]", "r0_ohm = [[0.03, 0.02], [0.02]]", 13, "circuit.r0_ohm"),
        ("tau_s = 10.0", "tau_s = 0.0", 17, "circuit.rc[0].tau_s"),
        ("tau_s = 10.0", "tau_s = 10.0\n[[circuit.rc]]\nr_ohm = -0.01\ntau_s = 2.0", 19, "circuit.rc[1].r_ohm"),
        ("tau_s = 10.0", "tau_s = 10.0" + 4 * "\n[[circuit.rc]]\nr_ohm = 0.01\ntau_s = 2.0", 28, "circuit.rc[4].r_ohm"),
        ("capacity_ah = 2.5", "capacity_ah = 1" + 400 * "0", 2, "capacity_ah"),
        ("v_max_v = 4.2", "v_max_v = inf", 4, "v_max_v"),
        ("v_max_v = 4.2", "v_max_v = 4.2\nv_nominal_v = 4.3", 5, "v_nominal_v"),
        ("v_max_v = 4.2", "v_max_v = 4.2\nmass_kg = 0", 5, "mass_kg"),
        ("v_max_v = 4.2", "v_max_v = 4.2\nmass_kg = 45.0", 5, "mass_kg"),
        ("voltage_v = [3.0, 3.6, 4.2]", "voltage_v = [3000.0, 3600.0, 4200.0]", 8, "ocv.voltage_v"),
        (
            "soc = [0.0, 0.5, 1.0]\nvoltage_v = [3.0, 3.6, 4.2]",
            "soc = [0, 1]\nvoltage_v = [false, true]",
            8,
            "ocv.voltage_v",
        ),
        ("r0_ohm = [[0.03, 0.02], [0.02, 0.01]]", "r0_ohm = 20.0", 13, "circuit.r0_ohm"),
        ("[circuit]", "[asinh]\nvoltage_v = 0.01\n[circuit]", 10, "asinh.current_a"),
        ("[circuit]", "[limits]\ncharge_max_a = -4.0\n[circuit]", 11, "limits.charge_max_a"),
        ("[circuit]", "[limits]\ntemperature_max_degc = 333.0\n[circuit]", 11, "limits.temperature_max_degc"),
        ("tau_s = 10.0", "", 15, "circuit.rc[0].tau_s"),
        ("tau_s = 10.0", "tau = 10.0", 17, "circuit.rc[0].tau"),
        ("[circuit]", "[circuits]", 10, "circuits"),
        ("name =", "nom =", 1, "nom"),
    ],
)
def test_errors_name_the_line_and_the_field(old, new, line, field):
    with pytest.raises(CellFileError) as caught:
        parse_cell(GOOD.replace(old, new, 1), "bench.toml")
    assert caught.value.field.removesuffix("]") == field.removesuffix("]")
    assert caught.value.line == line
    assert "bench.toml" in str(caught.value)
    assert field in str(caught.value)


def test_text_that_is_not_toml_names_the_line():
    with pytest.raises(CellFileError) as caught:
        parse_cell("name = \n", "x.toml")
    assert caught.value.line == 1


def test_a_missing_file_lists_the_bundled_cells():
    with pytest.raises(CellFileError, match=DEFAULT_CELL):
        load_cell("no-such-cell")


def test_a_byte_order_mark_is_no_part_of_the_file(tmp_path):
    path = tmp_path / "marked.toml"
    path.write_text(GOOD, encoding="utf-8-sig")
    assert load_cell(path).capacity_ah == 2.5
