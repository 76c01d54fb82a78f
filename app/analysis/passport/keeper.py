"""Keeps the cell passports up to date: reads each finished session once, in a thread of its own."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from app.analysis.passport.history import Passports, SessionRecord, Stretch, Swap, passports
from app.analysis.session_cell import cell_of
from app.analysis.session_survey import survey_session
from app.analysis.survey import Piece, Rest
from app.analysis.totals import MAX_STEP_S, listed
from app.battery.battery import Battery
from app.battery.library import file_name_of
from app.errors import ConfigError
from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import CellModel
from app.estimation.health.capacity import CapacityTracker
from app.estimation.health.rest_capacity import CapacityBetweenRests
from app.sessions.car import car_of
from app.sessions.catalogue import Catalogue
from app.sessions.errors import SessionError
from app.sessions.info import SessionInfo
from app.sessions.passport_store import PassportStore
from app.sessions.reading.reader import SessionFile
from app.sessions.storage.own_database import OnSetAside, nobody_asks
from app.sources.loaded_battery import team_battery
from app.words import Message, naming_cells

log = logging.getLogger(__name__)


class _Stretches(CapacityTracker):
    """A tracker that keeps what it was told, so that it can be told again to another."""

    def __init__(self, nominal_ah: float, n_cells: int) -> None:
        super().__init__(nominal_ah, n_cells)
        self.stretches: list[Stretch] = []

    def observe(
        self, soc_moved: ArrayLike, soc_moved_sigma: ArrayLike, charge_ah: ArrayLike, charge_sigma_ah: ArrayLike
    ) -> None:
        self.stretches.append(
            Stretch(
                np.array(soc_moved, dtype=np.float64),
                float(np.asarray(soc_moved_sigma)),
                float(np.asarray(charge_ah)),
                float(np.asarray(charge_sigma_ah)),
            )
        )


class RestCounter:
    """Counts the charge between the rests of a session; give `add` to `survey_session` as `also`."""

    def __init__(self, cell: CellModel, n_cells: int) -> None:
        self._tracker = _Stretches(cell.capacity_ah, n_cells)
        self._rests = CapacityBetweenRests(cell, self._tracker)
        self._last_s: float | None = None

    def add(self, piece: Piece) -> None:
        """Take the next piece."""
        for at_s, current_a, volts in zip(
            piece.time_s.tolist(), piece.current_a.tolist(), piece.voltage_v, strict=True
        ):
            dt_s = 0.0 if self._last_s is None else at_s - self._last_s
            self._last_s = at_s
            if current_a == current_a and 0.0 <= dt_s <= MAX_STEP_S:
                self._rests.step(dt_s, current_a, volts)

    @property
    def stretches(self) -> tuple[Stretch, ...]:
        """What was counted between two rests, in order."""
        return tuple(self._tracker.stretches)


def record_of(session: SessionFile, todays: CellModel) -> SessionRecord:
    """Return what a session tells about every cell, by its own cell file; by today's where it keeps none."""
    of_then, is_of_then = cell_of(session)
    cell = of_then if is_of_then else todays
    n_cells = session.battery.n_cells
    rests = RestCounter(cell, n_cells)
    survey = survey_session(session, rests.add)
    info = session.info
    first, last = survey.first_rest, survey.last_rest
    return SessionRecord(
        session_id=info.id,
        start_s=info.started_wall_ns / 1e9,
        end_s=(info.ended_wall_ns or info.started_wall_ns) / 1e9,
        resistance_ohm=survey.resistance_ohm,
        balancing_s=survey.balancing_s,
        first_rest_s=None if first is None else first.time_s,
        first_rest_v=_volts(first, n_cells),
        last_rest_s=None if last is None else last.time_s,
        last_rest_v=_volts(last, n_cells),
        stretches=rests.stretches,
        nominal_ah=cell.capacity_ah if is_of_then else None,
        first_rest_soc=cell.ocv.soc_at(_volts(first, n_cells)) if is_of_then else None,
        last_rest_soc=cell.ocv.soc_at(_volts(last, n_cells)) if is_of_then else None,
    )


class PassportKeeper:
    """Reads sessions that are new in the background; answers with what is known so far."""

    def __init__(
        self,
        folder: Path,
        catalogue: Catalogue,
        cell: CellModel,
        *,
        battery: Battery | None = None,
        simulated: bool = False,
        also: Callable[[SessionFile], object] | None = None,
        also_lost: threading.Event | None = None,
        on_set_aside: OnSetAside = nobody_asks,
    ) -> None:
        """Keep passports in a data folder: those of cars, or those of simulated ones, each by itself.

        Args:
            folder: of the data.
            catalogue: of the sessions.
            cell: today's cell.
            battery: whose sessions are read, a file for each; None: the team's own.
            simulated: of the simulated car.
            also: is given every session that is read, while it is open.
            also_lost: set where what `also` kept is lost: every session is read again.
            on_set_aside: told where the store was damaged and set aside.

        Raises:
            AppError: the file cannot be used.
        """
        self.battery = battery or team_battery().battery
        own = "" if self.battery == team_battery().battery else f"-{file_name_of(self.battery.name)}"
        self.store = PassportStore(folder / f"passport{own}{'-simulated' if simulated else ''}.sqlite", on_set_aside)
        self._is_simulated = simulated
        self._also = also
        self._also_lost = also_lost or threading.Event()
        self._again: set[str] = set()  # sessions of the store that are read again
        self._catalogue = catalogue
        self._cell = cell
        self._lock, self._reading = threading.Lock(), threading.Lock()
        self._thread: threading.Thread | None = None
        self._progress = (0, 0)
        self._unreadable: set[str] = set()
        self._of_other_batteries: set[str] = set()  # sessions of other batteries
        self._is_closing = False

    @property
    def progress(self) -> tuple[int, int]:
        """Sessions read and to be read, of the run that is under way; (0, 0) without one."""
        return self._progress

    def update(self) -> None:
        """Begin to read what is new, in the background; nothing where there is none, or that is under way already."""
        with self._lock:
            if self._is_closing or (self._thread is not None and self._thread.is_alive()):
                return
            new = self._new()
            if new:
                self._progress = (0, len(new))  # before anybody asks
                self._thread = threading.Thread(target=self.read_new, name="passport", daemon=True)
                self._thread.start()

    def _new(self) -> list[SessionInfo]:
        """Finished sessions that are not in the store yet, the oldest first; names the cars of old records."""
        infos = self._catalogue.list()
        without_car = self.store.without_car()
        for info in infos:
            if info.id in without_car:
                self.store.name_car(info.id, car_of(info, self.battery.name))
        stored = self.store.known()
        if self._also_lost.is_set():
            self._also_lost.clear()
            self._again |= stored
        known = (stored - self._again) | self._unreadable | self._of_other_batteries
        found = [
            info
            for info in infos
            if info.is_closed and info.id not in known and self._is_ours(info.metadata.get("source"))
        ]
        return found[::-1]

    def read_new(self, on_progress: Callable[[int, int], None] = lambda done, of: None) -> int:
        """Read every finished session that is not in the store yet; return how many. One thread at a time.

        `on_progress` is called with how many are read, of how many.
        """
        with self._reading:
            return self._read(self._new(), on_progress)

    def _read(self, new: list[SessionInfo], on_progress: Callable[[int, int], None]) -> int:
        done = 0
        for k, info in enumerate(new):
            if self._is_closing:
                break
            self._progress = (k, len(new))
            on_progress(k, len(new))
            self._again.discard(info.id)
            try:
                with self._catalogue.open_file(info.path) as session:
                    if not self._is_of_battery(session.battery):
                        self._of_other_batteries.add(info.id)
                        continue
                    record = record_of(session, self._cell)
                    if self._also is not None:
                        self._also(session)
                car = car_of(info, self.battery.name)
                self.store.add_record(info.id, info.started_wall_ns, car, _to_json(record))
                done += 1
            except SessionError as error:
                self._unreadable.add(info.id)
                log.warning("session %s is not in the passports: %s", info.id, error)
            except Exception:  # the sessions after it are read all the same
                self._unreadable.add(info.id)
                log.exception("session %s is not in the passports", info.id)
        on_progress(len(new), len(new))
        self._progress = (0, 0)
        return done

    def _is_ours(self, source: object) -> bool:
        """A session that does not say where it comes from is taken for the car's."""
        return (source == "simulator") == self._is_simulated

    def _is_of_battery(self, battery: Battery) -> bool:
        """A profile may have been edited meanwhile: name and shape tell a battery."""
        return (battery.name, battery.segments) == (self.battery.name, self.battery.segments)

    def car(self, wanted: str = "") -> str:
        """Return the car of that name; of none that of the newest session, empty before any has been read.

        Raises:
            ConfigError: there are other cars alone.
        """
        cars = self.store.cars()
        if wanted and cars and wanted not in cars:
            raise ConfigError("car", wanted, Message("one-of", choices=tuple(sorted(cars))))
        return wanted or next(iter(cars), "")

    def passports(self, car: str = "") -> Passports:
        """Return the life of every cell of a car, out of what has been read; of none as `car` says."""
        car = self.car(car)
        records = [_from_json(body) for body in self.store.records(car)]
        swaps = [swap for swap in self.swaps() if swap.is_of(car)]
        with naming_cells(self.battery.segments):
            return passports(records, swaps, self._cell.capacity_ah, self._cell.ocv.soc_at, self.battery.n_cells)

    def swaps(self) -> list[Swap]:
        """Return the swaps of modules of all cars, in the order in which they were told."""
        return [Swap(swap.time_s, tuple(swap.cells), swap.note, swap.car) for swap in self.store.swaps()]

    def swap(self, cells: list[int], time_s: float, note: str, who: str | None, car: str = "") -> None:
        """Record that modules of a car were swapped; from then on their cells begin a new line.

        Without a car it is the only one there is, and before any has been read it counts for every car.

        Raises:
            ConfigError: no cell, or one that there is not; no such car, or which of several is not said.
            RecordingFailed: the disk does not take it.
        """
        cars = self.store.cars()
        if not car and len(cars) > 1:
            raise ConfigError("car", car, Message("one-of", choices=tuple(sorted(cars))))
        of_car = self.car(car) or None
        n_cells = self.battery.n_cells
        if not cells or not all(0 <= cell < n_cells for cell in cells):
            raise ConfigError("cells", cells, f"at least one of 0..{n_cells - 1}")
        self.store.add_swap(round(time_s * 1e9), cells, note, who, of_car)

    def close(self) -> None:
        """Stop reading and close the store."""
        with self._lock:
            self._is_closing = True
            thread = self._thread
        if thread is not None:
            thread.join(timeout=10.0)
        self.store.close()


def _volts(rest: Rest | None, n_cells: int) -> FloatArray:
    return np.full(n_cells, np.nan) if rest is None else rest.voltage_v


def _array(values: list[float | None]) -> FloatArray:
    return np.array(values, dtype=np.float64)


def _to_json(record: SessionRecord) -> dict[str, Any]:
    return {
        "session_id": record.session_id,
        "start_s": record.start_s,
        "end_s": record.end_s,
        "resistance_ohm": listed(record.resistance_ohm, 8),
        "balancing_s": listed(record.balancing_s, 1),
        "first_rest_s": record.first_rest_s,
        "first_rest_v": listed(record.first_rest_v, 5),
        "last_rest_s": record.last_rest_s,
        "last_rest_v": listed(record.last_rest_v, 5),
        "nominal_ah": record.nominal_ah,
        "first_rest_soc": None if record.first_rest_soc is None else listed(record.first_rest_soc, 6),
        "last_rest_soc": None if record.last_rest_soc is None else listed(record.last_rest_soc, 6),
        "stretches": [
            {
                "soc_moved": listed(stretch.soc_moved, 6),
                "soc_moved_sigma": stretch.soc_moved_sigma,
                "charge_ah": stretch.charge_ah,
                "charge_sigma_ah": stretch.charge_sigma_ah,
            }
            for stretch in record.stretches
        ],
    }


def _from_json(body: dict[str, Any]) -> SessionRecord:
    arrays = ("resistance_ohm", "balancing_s", "first_rest_v", "last_rest_v")
    stretches = tuple(Stretch(**each | {"soc_moved": _array(each["soc_moved"])}) for each in body["stretches"])
    known = {name: _array(body[name]) for name in ("first_rest_soc", "last_rest_soc") if body.get(name) is not None}
    return SessionRecord(**body | {name: _array(body[name]) for name in arrays} | known | {"stretches": stretches})
