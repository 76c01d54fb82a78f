"""The estimator in single precision, as on the microcontroller, beside the pit wall's on the simulated race."""

import ctypes
from collections.abc import Iterator

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import make_estimator
from app.estimation.filters.tables import CellTables
from firmware_protocol.memory_map import FIELDS, MASTER_SIZE, N_CELLS
from simulator.library import find_scenario
from simulator.scenario_player import ScenarioPlayer
from tests.c_programs import estimator_library
from tests.campaign import campaign, of_size

CELL = load_cell("samsung-25r-10p")
START_CELLS = 12  # `VW_START_CELLS`
SIZE_BYTES = 1 << 16  # more than `vw_estimator_t`
RACE_S = of_size(60, 300, 1700)
STEP_S = 0.1


def race(seconds: float) -> Iterator[tuple[float, bytes]]:
    """Yield the time and the master's struct, ten times a second."""
    player = ScenarioPlayer(find_scenario("clean-endurance"), seed=11, step_s=0.05)
    while player.simulation.now_s < seconds and not player.is_over:
        player.run(STEP_S)
        yield player.simulation.now_s, bytes(player.simulation.master.image)


class Chip:
    """The C library on a struct of its own."""

    def __init__(self) -> None:
        self.library = ctypes.CDLL(str(estimator_library()))
        self.memory = ctypes.create_string_buffer(SIZE_BYTES)
        self.image = ctypes.create_string_buffer(MASTER_SIZE)
        self.library.vw_estimator_init(self.memory)
        self.library.vw_estimator_run.restype = ctypes.c_bool

    def run(self, time_s: float, image: bytes) -> int:
        """Return how many runs a measurement took."""
        ctypes.memmove(self.image, image, MASTER_SIZE)
        runs = 1
        while self.library.vw_estimator_run(self.memory, self.image, ctypes.c_uint32(round(time_s * 1000))):
            runs += 1
        return runs

    def read(self, name: str):
        field = FIELDS[name]
        return np.array(field.unpack(self.image.raw)) * field.scale


def measured(image: bytes):
    """Current, voltages and temperatures of a struct, as the pit wall has them."""
    values = {name: np.array(FIELDS[name].unpack(image)) * FIELDS[name].scale for name in ("i_fs", "v", "t")}
    return float(values["i_fs"][0]), values["v"], np.where(values["t"] == -128.0, np.nan, values["t"])


@campaign(120, 200, 600)
def test_soc_and_ocv_of_the_master_are_the_pit_walls_over_a_race(tell):
    chip, wall = Chip(), make_estimator("fused", CELL, N_CELLS)
    before_ms, worst_soc, worst_ocv_soc = None, 0.0, 0.0
    curve = CellTables(CELL)
    for time_s, image in race(RACE_S):
        current_a, volts, degc = measured(image)
        now_ms = round(time_s * 1000)
        if before_ms is None:
            wall.start(volts, degc, current_a)
            before_ms = now_ms
        expected = wall.step((now_ms - before_ms) / 1000.0, current_a, volts, degc)
        before_ms = now_ms
        chip.run(time_s, image)
        worst_soc = max(worst_soc, abs(chip.read("soc")[0] - expected.soc.mean()))
        by_ocv = curve.soc_of_ocv(chip.read("ocv")) - curve.soc_of_ocv(expected.ocv_v)
        worst_ocv_soc = max(worst_ocv_soc, float(np.abs(by_ocv).max()))
    tell(f"estimator on the master: {100 * worst_soc:.3f} points off the pit wall's in {RACE_S} s of racing")
    assert worst_soc < 0.001
    assert worst_ocv_soc < 0.001


def test_a_soc_that_is_set_is_where_the_count_goes_on():
    chip = Chip()
    _, image = next(race(2.0))
    assert chip.run(0.0, image) == 1 + N_CELLS / START_CELLS  # a start is spread over so many runs
    soc = chip.read("soc")[0]
    near = round((soc - 0.002) * 10_000)
    chip.library.vw_estimator_set_soc(chip.memory, ctypes.c_uint16(near))
    assert chip.run(0.1, image) == 1 + N_CELLS / START_CELLS
    assert chip.read("soc")[0] == pytest.approx(near / 10_000, abs=1e-3)


def test_what_is_not_measured_is_missing_on_the_master_too():
    chip, wall = Chip(), make_estimator("fused", CELL, N_CELLS)
    _, image = next(race(2.0))
    master = bytearray(image)
    FIELDS["v"].pack_into(master, tuple([0, 65535] + [37000] * (N_CELLS - 2)))
    FIELDS["t"].pack_into(master, tuple([-128] * 4 + [25] * (N_CELLS - 4)))
    current_a, volts, degc = measured(bytes(master))
    wall.start(volts, degc, current_a)
    expected = wall.step(0.0, current_a, volts, degc)
    chip.run(0.0, bytes(master))
    np.testing.assert_allclose(chip.read("ocv"), expected.ocv_v, atol=2e-3)
