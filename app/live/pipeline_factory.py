"""What the names of a filter and a cell stand for: the one place where they become a pipeline."""

from collections.abc import Callable

from app.battery.shape import N_CELLS
from app.errors import ConfigError
from app.estimation.cell_model.cell_file import load_cell
from app.estimation.errors import EstimatorError
from app.estimation.filters.estimators import FILTERS, CellEstimator, make_estimator
from app.live.pipeline import Pipeline
from app.live.prediction import Predictor
from app.sources.master.source import MasterSource
from app.telemetry import FloatArray, Source
from app.words import Message


class PipelineFactory:
    """A filter and a cell for 96 cells; makes as many pipelines as asked for."""

    def __init__(self, filter_name: str, cell_name: str) -> None:
        """Read the cell file.

        Raises:
            ConfigError: there is no such filter, or the cell cannot be used.
        """
        if filter_name not in FILTERS:
            raise ConfigError("filter", filter_name, Message("one-of", choices=tuple(FILTERS)))
        try:
            self.cell = load_cell(cell_name)
        except EstimatorError as error:
            raise ConfigError("cell", cell_name, str(error)) from error
        self._filter_name = filter_name
        self._cell_name = cell_name

    def pipeline(
        self,
        source: Source,
        rs232_url: str | None = None,
        can_url: str | None = None,
        *,
        predictor: Predictor | None = None,
        start_soc: tuple[FloatArray, FloatArray] | None = None,
        stopwatch_ns: Callable[[], int] | None = None,
    ) -> Pipeline:
        """Return a fresh pipeline; without `predictor` nothing of the cells was learned before."""
        return Pipeline(
            MasterSource(source, rs232_url, can_url),
            self._new_estimator,
            filter_name=self._filter_name,
            cell_name=self._cell_name,
            stopwatch_ns=stopwatch_ns,
            predictor=predictor or Predictor(self.cell, N_CELLS),
            start_soc=start_soc,
        )

    def _new_estimator(self) -> CellEstimator:
        return make_estimator(self._filter_name, self.cell, N_CELLS)
