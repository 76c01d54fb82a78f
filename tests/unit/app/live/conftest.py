"""A pipeline that learns from what a made-up master sends over an open RS232 link."""

from collections.abc import Callable

import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import make_estimator
from app.live.pipeline import Pipeline
from app.live.prediction import Predictor
from app.sources.items import LinkChange
from app.sources.master.source import MasterSource

CELL = load_cell("samsung-25r-10p")


@pytest.fixture
def make_pipeline() -> Callable[[], Pipeline]:
    def make() -> Pipeline:
        chain = Pipeline(
            MasterSource("serial", "/dev/x", "off"),
            lambda: make_estimator("fused", CELL, 96),
            filter_name="fused",
            cell_name="samsung-25r-10p",
            predictor=Predictor(CELL, (12,) * 8),
        )
        chain.feed(LinkChange(0, 0, "rs232", "open"))
        return chain

    return make
