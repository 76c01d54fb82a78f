"""Makes pipelines with the estimator of the settings, or with another filter or cell."""

import time

from app.errors import ConfigError
from app.estimation.cell_model.cell_file import bundled_cells
from app.estimation.cell_model.circuit import CellModel
from app.estimation.health.cell_watch import CellWatch
from app.live.pipeline import Pipeline
from app.live.pipeline_factory import PipelineFactory
from app.live.prediction import LearnedCells, Predictor
from app.service.settings import Settings
from app.sources.loaded_battery import LoadedBattery
from app.telemetry import FloatArray, Source
from app.words import Message


class Pipelines:
    """The configured filter and cell, and every other that a replay may choose."""

    def __init__(self, settings: Settings, battery: LoadedBattery | None = None) -> None:
        """Read the cell file; without `battery` it is the team's own.

        Raises:
            ConfigError: there is no such filter, or the cell cannot be used.
        """
        self._filter_name = settings.filter
        self._chain = PipelineFactory(settings.filter, settings.cell, battery)
        self._cell_name = settings.cell or self._chain.battery.battery.cell
        self.cell = self._chain.cell

    @property
    def cells(self) -> list[str]:
        """Names of the cells to choose from beside the session's own, the configured one first."""
        return list(dict.fromkeys((self._cell_name, *bundled_cells())))

    def predictor(self, learned_before: LearnedCells | None) -> Predictor:
        """Return a predictor of the configured cells that goes on with what earlier sessions learned."""
        return self._chain.predictor(learned_before)

    def new(
        self,
        source: Source,
        serial_url: str | None = None,
        can_url: str | None = None,
        predictor: Predictor | None = None,
        start_soc: tuple[FloatArray, FloatArray] | None = None,
        filter_name: str | None = None,
        cell_name: str | None = None,
        battery: LoadedBattery | None = None,
        cell: CellModel | None = None,
        watch: CellWatch | None = None,
        looks_ahead: bool = True,
    ) -> Pipeline:
        """Return a fresh pipeline; None is the configured filter, cell or battery.

        `cell` is what `cell_name` stands for, `watch` has watched the cells until then; without `looks_ahead` it
        predicts nothing.

        Raises:
            ConfigError: there is no such filter or cell.
        """
        chain = self._chain
        is_another = battery is not None and battery.files != chain.battery.files
        if filter_name is not None or cell_name is not None or is_another:
            cell_name = cell_name or (battery.battery.cell if battery is not None and is_another else self._cell_name)
            if cell is None and cell_name not in self.cells:  # also that of a session from elsewhere: it may be a path
                raise ConfigError("cell", cell_name, Message("one-of-cells", choices=tuple(bundled_cells())))
            chain = PipelineFactory(filter_name or self._filter_name, cell_name, battery or chain.battery, cell)
        return chain.pipeline(
            source,
            serial_url,
            can_url,
            predictor=predictor,
            watch=watch,
            start_soc=start_soc,
            stopwatch_ns=time.perf_counter_ns,
            looks_ahead=looks_ahead,
        )

    def for_import(self, battery: LoadedBattery) -> Pipeline:
        """Return a pipeline that recordings of other systems go through."""
        return self.new("replay", "imported", "imported", battery=battery, looks_ahead=False)
