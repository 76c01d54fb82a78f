"""Every error of the numerics names what is wrong and where."""

import pytest

from app.estimation.errors import CellFileError, DatasetError, EstimatorError, ModelError, ShapeError, check_step


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (ModelError("capacity_ah", "has to be positive"), "capacity_ah: has to be positive"),
        (CellFileError("a.toml", 7, "ocv.soc", "falls"), "a.toml, line 7: ocv.soc: falls"),
        (CellFileError("a.toml", None, "ocv.soc", "falls"), "a.toml: ocv.soc: falls"),
        (CellFileError("a.toml", 3, "", "no TOML"), "a.toml, line 3: no TOML"),
        (ShapeError("soc", (96,), (12,)), "soc has shape (12,), expected (96,)"),
        (DatasetError("run.csv", "no column of time"), "run.csv: no column of time"),
    ],
)
def test_the_text_names_place_and_reason(error, text):
    assert str(error) == text
    assert isinstance(error, EstimatorError)


def test_a_cell_file_at_fault_is_a_model_at_fault():
    with pytest.raises(ModelError) as caught:
        raise CellFileError("a.toml", 7, "ocv.soc", "falls")
    assert (caught.value.path, caught.value.line) == ("a.toml", 7)
    assert (caught.value.field, caught.value.reason) == ("ocv.soc", "falls")


def test_a_wrong_shape_keeps_both_shapes():
    error = ShapeError("soc", (96,), (8, 12))
    assert (error.name, error.expected, error.received) == ("soc", (96,), (8, 12))


@pytest.mark.parametrize("dt_s", [-1e-9, float("nan"), float("inf"), float("-inf")])
def test_a_step_that_no_time_can_have_is_refused_with_its_value(dt_s):
    with pytest.raises(EstimatorError, match=f"dt_s is {dt_s}"):
        check_step(dt_s)


@pytest.mark.parametrize("dt_s", [0.0, 0.1, 1e6])
def test_no_step_and_a_long_one_are_steps(dt_s):
    check_step(dt_s)
