"""The layouts that Python uses are those of the C headers, and a library that does not fit is not used."""

import ctypes
import re
from dataclasses import fields

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.errors import EstimatorError
from app.estimation.filters.engine import library
from app.estimation.filters.estimates import Estimates
from app.estimation.filters.estimators import make_estimator
from app.estimation.filters.setup import Kind
from app.estimation.filters.tuning import Tuning
from firmware_protocol.c_library import sources_digest
from tests.oracle.state import State


def header(name: str) -> str:
    text = (library.FOLDER / name).read_text(encoding="utf-8")
    return re.sub(r"/\*.*?\*/|^#(if|endif).*?$", "", text, flags=re.DOTALL | re.MULTILINE)


def fields_of(struct: str, name: str) -> list[str]:
    """Names of a struct's fields, in order."""
    body = re.search(r"typedef struct \{([^}]*)\} " + struct + ";", header(name))[1]
    return [re.split(r"[\s*]+", line.split("[")[0].strip())[-1] for line in body.split(";") if line.strip()]


@pytest.mark.parametrize(
    ("struct", "name", "ours"),
    [
        ("vw_tuning", "vw_filter.h", library.TuningStruct),
        ("vw_sigma_rule", "vw_filter.h", library.SigmaRuleStruct),
        ("vw_filter", "vw_filter.h", library.FilterStruct),
        ("vw_sample", "vw_filter.h", library.SampleStruct),
        ("vw_cell_model", "vw_cell_model.h", library.CellModelStruct),
    ],
)
def test_structs_have_the_fields_of_their_headers_in_order(struct, name, ours):
    assert [field for field, _ in ours._fields_] == fields_of(struct, name)


def test_state_rows_have_the_same_names_in_c_in_numpy_and_in_the_reference():
    *rows, terms, segments = fields_of("vw_cells", "vw_filter.h")
    assert rows == list(library.CELL_ROWS) == [each.name for each in fields(State)]
    # what the engine keeps of temperatures and tables to look them up but once
    assert (terms, segments) == ("terms", "segments")
    assert list(library.SEGMENT.names) == fields_of("vw_segment", "vw_cell_model.h")


def test_every_number_of_the_tuning_reaches_the_engine():
    assert fields_of("vw_tuning", "vw_filter.h") == [each.name for each in fields(Tuning)]


def test_rows_of_an_estimate_and_kinds_are_numbered_alike():
    rows = re.search(r"enum \{([^}]*VW_ESTIMATES)\s*\}", header("vw_filter.h"))[1].split(",")
    names = ["SOC", "SOC_SIGMA", "OCV_V", "VOLTAGE_V", "INNOVATION_V", "INNOVATION_SIGMA", "MODEL_VALID", "ACCEPTED"]
    assert [row.strip() for row in rows] == [f"VW_{name}" for name in (*names, "ESTIMATES")]
    for name in names:
        assert any(hasattr(Estimates, each) for each in (name.lower(), f"{name.lower()}_v"))
    kinds = re.search(r"typedef enum \{([^}]*)\} vw_kind", header("vw_filter.h"))[1].split(",")
    assert [kind.strip() for kind in kinds if kind.strip()] == [f"VW_{kind.name}" for kind in Kind]


def test_the_library_is_built_from_these_sources():
    loaded = library.load()
    assert loaded.vw_library_sources().decode() == sources_digest(sorted(library.FOLDER.glob("v*.[ch]")))
    assert loaded.vw_library_size_of_filter() == ctypes.sizeof(library.FilterStruct)
    assert loaded.vw_library_size_of_cells() == library.CELLS.itemsize


def refused(monkeypatch, what):
    library.load.cache_clear()
    with pytest.raises(EstimatorError, match=what):
        library.load()
    monkeypatch.undo()
    library.load.cache_clear()


def test_a_missing_broken_or_outdated_library_is_refused(monkeypatch, tmp_path):
    monkeypatch.setattr(library, "LIBRARY", tmp_path / "vw_filter.so")
    refused(monkeypatch, "is missing")
    broken = tmp_path / "broken.so"
    broken.write_bytes(b"no library")
    monkeypatch.setattr(library, "LIBRARY", broken)
    refused(monkeypatch, "cannot be loaded")
    monkeypatch.setattr(library, "FOLDER", tmp_path)
    refused(monkeypatch, "other sources")


def test_every_variant_that_this_processor_runs_gives_the_same_numbers(monkeypatch):
    answers = []
    for variants in (library.FASTER, library.FASTER[-1:], ()):
        library.load.cache_clear()
        monkeypatch.setattr(library, "FASTER", variants)
        estimator = make_estimator("fused", load_cell(), 40)
        estimator.start(np.linspace(3.3, 4.1, 40), np.full(40, 30.0), 0.0, soc=0.5)
        for step in range(100):
            found = estimator.step(0.1, 3.0 * step, np.linspace(3.2, 4.1, 40), np.full(40, 30.0 + step // 50))
        answers.append(found.numbers)
    monkeypatch.undo()
    library.load.cache_clear()
    for numbers in answers[1:]:
        np.testing.assert_allclose(numbers, answers[0], rtol=1e-12, atol=1e-12)
