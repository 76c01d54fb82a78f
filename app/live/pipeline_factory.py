"""The one factory of pipelines: what the names of a filter and a cell stand for, and of which battery."""

from collections.abc import Callable

from app.errors import AppError, ConfigError
from app.estimation.cell_model.cell_file import bundled_cells, load_cell
from app.estimation.cell_model.circuit import CellModel
from app.estimation.errors import EstimatorError
from app.estimation.filters.engine.library import load
from app.estimation.filters.estimators import FILTERS, SocEstimator, make_estimator
from app.estimation.health.cell_watch import CellWatch
from app.live.pipeline import Pipeline
from app.live.prediction import LearnedCells, Predictor
from app.live.remembered_charge import RememberedCharge
from app.sources.dbc.source import DbcSource
from app.sources.loaded_battery import LoadedBattery, team_battery
from app.sources.master.source import MasterSource
from app.sources.serial.source import SerialSource
from app.sources.source import MeasurementSource
from app.sources.table_source import TableSource
from app.telemetry import Alarm, Source
from app.telemetry.cell_findings import sensors_of
from app.words import Message


class PipelineFactory:
    """A filter and a cell for each cell of a battery; makes as many pipelines as asked for."""

    def __init__(
        self,
        filter_name: str,
        cell_name: str | None = None,
        battery: LoadedBattery | None = None,
        cell: CellModel | None = None,
        stopwatch_ns: Callable[[], int] | None = None,
    ) -> None:
        """Read the cell file, unless the cell is given.

        Args:
            filter_name: one of FILTERS.
            cell_name: a cell file, or the name of a bundled one; None: that of the battery.
            battery: None: the team's own.
            cell: what `cell_name` stands for, where it is no file.
            stopwatch_ns: measures what a sample takes to estimate; None: it is not measured.

        Raises:
            ConfigError: there is no such filter, or the cell cannot be used.
            AppError: the estimator's library is missing or does not fit.
        """
        self.battery = battery or team_battery()
        cell_name = cell_name or self.battery.battery.cell
        if filter_name not in FILTERS:
            raise ConfigError("filter", filter_name, Message("one-of", choices=tuple(FILTERS)))
        try:
            self.cell = cell or load_cell(cell_name)
        except EstimatorError as error:
            raise ConfigError("cell", cell_name, str(error)) from error
        try:
            load()
        except EstimatorError as error:
            raise AppError(str(error)) from error
        self._filter_name = filter_name
        self._cell_name = cell_name
        self._stopwatch_ns = stopwatch_ns

    @property
    def cells(self) -> list[str]:
        """Names of the cells that can be chosen, the own one first."""
        return list(dict.fromkeys((self._cell_name, *bundled_cells())))

    def chosen(
        self,
        filter_name: str | None = None,
        cell_name: str | None = None,
        battery: LoadedBattery | None = None,
        cell: CellModel | None = None,
    ) -> "PipelineFactory":
        """Return the factory of another filter, cell or battery; None is the own one.

        A cell is chosen by a name of `cells`, also that of a battery from elsewhere, which may name any file; `cell` is
        what another name stands for.

        Raises:
            ConfigError: there is no such filter or cell.
        """
        is_another = battery is not None and battery.files != self.battery.files
        if filter_name is None and cell_name is None and not is_another:
            return self
        cell_name = cell_name or (battery.battery.cell if battery is not None and is_another else self._cell_name)
        if cell is None and cell_name not in self.cells:
            raise ConfigError("cell", cell_name, Message("one-of-cells", choices=tuple(bundled_cells())))
        return PipelineFactory(
            filter_name or self._filter_name, cell_name, battery or self.battery, cell, self._stopwatch_ns
        )

    def for_import(self, battery: LoadedBattery) -> Pipeline:
        """Return a pipeline that a recording of this battery by another system goes through.

        Raises:
            ConfigError: the battery names a cell that is none of `cells`.
        """
        return self.chosen(battery=battery).pipeline("replay", "imported", "imported", predicts=False)

    def pipeline(
        self,
        source: Source,
        rs232_url: str | None = None,
        can_url: str | None = None,
        *,
        predictor: Predictor | None = None,
        watch: CellWatch | None = None,
        remembered: RememberedCharge | None = None,
        alarms: tuple[Alarm, ...] = (),
        predicts: bool = True,
    ) -> Pipeline:
        """Return a fresh pipeline; without `predictor` nothing was learned before but what `watch` has seen.

        With `predicts` False it tells no power, energy and times to the limits: for who keeps estimates and events.
        """
        return Pipeline(
            self._source(source, rs232_url, can_url),
            self._new_estimator,
            filter_name=self._filter_name,
            cell_name=self._cell_name,
            stopwatch_ns=self._stopwatch_ns,
            predictor=predictor or self.predictor(watch=watch, predicts=predicts),
            remembered=remembered,
            alarms=alarms,
        )

    def predictor(
        self, learned_before: LearnedCells | None = None, watch: CellWatch | None = None, *, predicts: bool = True
    ) -> Predictor:
        """Return a fresh predictor that goes on with what earlier sessions learned."""
        battery = self.battery.battery
        sensors = sensors_of(battery.sensors, battery.n_cells)
        return Predictor(self.cell, battery.segments, learned_before, watch=watch, sensors=sensors, predicts=predicts)

    def _source(self, name: Source, rs232_url: str | None, can_url: str | None) -> MeasurementSource:
        mapping, serial = self.battery.dbc_mapping, self.battery.serial
        if self.battery.has_memory_map:
            return MasterSource(name, rs232_url, can_url)
        if serial is not None:
            return SerialSource(self.battery.battery, serial, rs232_url, name=name)
        if mapping is None:
            return TableSource(self.battery.battery, name, self.battery.means_s)
        return DbcSource(self.battery.battery, mapping, self.battery.definitions, can_url, name=name)

    def _new_estimator(self) -> SocEstimator:
        return make_estimator(self._filter_name, self.cell, self.battery.battery.n_cells)
