"""Compiled kernels outlive the process that compiled them, and a machine that cannot compile estimates all the same."""

import sys

import numpy as np
import pytest

pytest.importorskip("numba", reason="numba is an optional extra")

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.errors import EstimatorError
from app.estimation.filters.compiled import native
from app.estimation.filters.compiled.shape import Shape
from app.estimation.filters.estimators import make_estimator

SMALL = Shape(1, 0, 1, has_over=False, is_fixed=True, is_sigma=False, is_fused=False)
N = 3


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(native, "kernel_folder", lambda: tmp_path / "kernels")
    native.load.cache_clear()
    yield tmp_path / "kernels"
    native.load.cache_clear()


@pytest.fixture
def no_compiler(monkeypatch):
    monkeypatch.setattr(sys, "executable", "/nowhere/python")


@pytest.fixture(scope="module")
def code():
    return native._compiled("step", SMALL)


@pytest.fixture
def compilations(code, monkeypatch):
    """What was compiled, without the seconds that it takes."""
    done = []
    monkeypatch.setattr(native, "_compiled", lambda *what: done.append(what) or code)
    return done


def test_what_was_compiled_is_compiled_once(folder, compilations):
    for _ in range(2):
        native.load("step", SMALL)
        native.load.cache_clear()
    assert compilations == [("step", SMALL)]
    (kept,) = folder.glob("*.o")
    kept.write_bytes(kept.read_bytes()[:-100])
    native.load("step", SMALL)
    assert len(compilations) == 2


def test_who_waited_for_another_process_takes_what_it_compiled(folder, compilations, monkeypatch):
    native.load("step", SMALL)
    native.load.cache_clear()
    unread, read = [None], native._read
    monkeypatch.setattr(native, "_read", lambda path: unread.pop() if unread else read(path))
    native.load("step", SMALL)
    assert unread == []
    assert len(compilations) == 1


def test_a_shape_a_step_and_a_record_have_kernels_of_their_own(folder):
    keys = {native._key(what, SMALL._replace(n=n)) for what in ("step", "record") for n in (1, 2)}
    assert len(keys) == 4


@pytest.mark.usefixtures("folder", "no_compiler")
def test_numpy_estimates_where_nothing_can_be_compiled(caplog):
    estimator = make_estimator("ekf", load_cell(), N)
    assert estimator.engine == "numpy"
    assert "could not be compiled" in caplog.text
    with pytest.raises(EstimatorError, match="could not be compiled"):
        make_estimator("ekf", load_cell(), N, engine="numba")


def test_a_folder_that_cannot_be_written_costs_time_only(tmp_path, monkeypatch, compilations):
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(native, "kernel_folder", lambda: tmp_path / "file")
    native.load.cache_clear()
    for _ in range(2):
        native.load("step", SMALL)
        native.load.cache_clear()
    assert len(compilations) == 2


def test_what_is_not_contiguous_or_not_a_float_is_taken_all_the_same():
    one, two = (make_estimator("fused", load_cell(), 96, engine="numba") for _ in range(2))
    volts, degc = np.linspace(3.6, 3.9, 192)[::2], [25] * 96
    for estimator in (one, two):
        estimator.start(volts, degc, 0.0)
    volts.setflags(write=False)
    got, wanted = one.step(0.1, 5, volts, degc), two.step(0.1, 5.0, volts.copy(), np.full(96, 25.0))
    np.testing.assert_array_equal(got.numbers, wanted.numbers)
    before = got.numbers.copy()
    one.step(0.1, 90.0, volts, degc)
    np.testing.assert_array_equal(got.numbers, before)
