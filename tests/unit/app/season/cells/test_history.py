"""What a season knows of each cell, out of a lake: resistance, charge, rests, swapped modules."""

import numpy as np
import pytest

from app.errors import ConfigError
from app.estimation.cell_model.cell_file import format_cell, load_cell
from app.season.history import DAY_S, SeasonSource, lost_in_pause
from app.season.lake.build import build_lake, session_files
from app.season.lake.place import LakeFolder
from app.season.report import cell_of
from app.sessions.swaps import Swap
from app.sources.loaded_battery import load_battery, team_battery
from tests.recorded.arrays import START_S, SessionMaker

CELL = load_cell("samsung-25r-10p")
TIME_S = np.arange(0.0, 400.0, 0.5)
CURRENT_A = np.where((TIME_S > 150) & (TIME_S < 200), 60 + 50 * np.sin(TIME_S), 0.0)
AMPERE_HOURS = float(np.abs(CURRENT_A).sum()) * 0.5 / 3600
WEAK, LEAKY, LEAK = 30, 40, 0.004  # SOC a day


@pytest.fixture(scope="module")
def lake(tmp_path_factory):
    """Three sessions of the car, one a day, and one of the simulated car."""
    folder = tmp_path_factory.mktemp("history")
    make = SessionMaker(folder / "sessions")
    cells = np.arange(96)
    for day in range(4):
        soc = 0.8 - LEAK * day * (cells == LEAKY)
        volts = CELL.ocv.voltage(soc) - CURRENT_A[:, None] * np.where(cells == WEAK, 0.003, 0.002)
        metadata = {"source": "simulator"} if day == 3 else None
        start_s = START_S + day * DAY_S
        make(TIME_S, CURRENT_A, volts, 25, start_s=start_s, cell_file=format_cell(CELL), metadata=metadata)
    build_lake(LakeFolder(folder / "lake"), session_files([folder / "sessions"]))
    return str(folder / "lake")


def source(lake, *, simulated=False, swaps=()):
    return SeasonSource(lake, team_battery().battery, simulated, CELL, swaps)


def of_one(lake, **more):
    (found,) = source(lake, **more).histories()
    return found


def test_the_lake_tells_every_session_of_the_car_and_none_of_the_simulated_one(lake):
    found = of_one(lake)
    assert len(found.sessions) == 3
    assert np.diff(found.start_s) == pytest.approx(DAY_S)
    assert found.charge_ah == pytest.approx(AMPERE_HOURS * np.arange(1, 4), rel=0.02)
    assert found.is_absolute
    assert found.resistance[:, WEAK] / np.median(found.resistance, axis=1) == pytest.approx(1.5, abs=0.1)
    assert len(of_one(lake, simulated=True).sessions) == 1


def test_a_cell_that_loses_charge_in_the_pauses_is_known_with_its_rate(lake):
    found = of_one(lake)
    assert np.isnan(found.lost_per_day[0]).all()
    assert found.lost_per_day[1:, LEAKY] == pytest.approx(LEAK, rel=0.1)
    assert found.self_discharge_per_day[LEAKY] == pytest.approx(LEAK, rel=0.1)
    assert np.nanmax(np.delete(found.self_discharge_per_day, LEAKY)) < LEAK / 10
    assert np.ptp(found.rest_soc[2]) == pytest.approx(2 * LEAK, rel=0.1)


def test_a_swapped_module_inherits_nothing(lake):
    swap = Swap(START_S + 0.5 * DAY_S, (LEAKY,))
    found = of_one(lake, swaps=(swap,))
    assert found.is_present[:, LEAKY].tolist() == [False, True, True]
    assert found.is_present[:, WEAK].all()
    assert np.isnan(found.lost_per_day[1, LEAKY])
    assert found.lost_per_day[2, LEAKY] == pytest.approx(LEAK, rel=0.1)


def test_a_cell_has_a_value_a_session_also_of_the_module_before(lake):
    swap = Swap(START_S + 0.5 * DAY_S, (WEAK,))
    found = cell_of(of_one(lake, swaps=(swap,)), WEAK)
    assert found.module == [0, 1, 1]
    assert len(found.sessions) == 3
    assert found.resistance_ohm == pytest.approx([0.003] * 3, rel=0.05)
    assert None not in found.resistance.measured
    assert found.self_discharge.measured[:2] == [None, None]  # before the first session, and over the swap
    assert found.self_discharge.measured[2] == pytest.approx(0.0, abs=LEAK / 10)
    assert cell_of(of_one(lake), LEAKY).self_discharge.measured[1:] == pytest.approx([LEAK] * 2, rel=0.1)


def test_a_short_pause_and_one_in_which_the_pack_was_charged_say_nothing():
    soc, night_s = np.full(4, 0.8), 9 * 3600.0
    assert lost_in_pause(soc, soc - 0.001, night_s) == pytest.approx(np.full(4, 0.001))
    assert lost_in_pause(soc, soc - 0.001, 7 * 3600.0) is None
    assert lost_in_pause(soc, soc + 0.15, night_s) is None
    assert lost_in_pause(soc, np.full(4, np.nan), night_s) is None


def test_an_empty_lake_has_no_car(tmp_path):
    assert source(str(tmp_path)).histories() == source(str(tmp_path)).histories("red") == []


def test_a_second_accumulator_of_a_car_has_a_profile_of_its_own_name(tmp_path):
    """Of the same build, driven in turns with the first: a profile that includes the first keeps them apart."""
    (tmp_path / "spare.toml").write_text('include = ["team"]\n\n[battery]\nname = "spare accumulator"\n')
    accumulators = (team_battery(), load_battery(str(tmp_path / "spare.toml")))
    make = SessionMaker(tmp_path / "sessions")
    for day in range(4):
        volts = CELL.ocv.voltage(0.8 - LEAK * day * (day % 2 * (np.arange(96) == LEAKY))) - CURRENT_A[:, None] * 0.002
        start_s, red = START_S + day * DAY_S, {"car": "red"}
        make(TIME_S, CURRENT_A, volts, 25, start_s=start_s, metadata=red, battery=accumulators[day % 2])
    build_lake(LakeFolder(tmp_path / "lake"), session_files([tmp_path / "sessions"]))
    found = []
    for each in accumulators:
        (history,) = SeasonSource(str(tmp_path / "lake"), each.battery, False, CELL).histories()
        assert history.car == "red"
        assert history.charge_ah == pytest.approx(AMPERE_HOURS * np.arange(1, 3), rel=0.02)
        found.append(history)
    own, spare = found
    assert not set(own.sessions) & set(spare.sessions)
    assert abs(own.self_discharge_per_day[LEAKY]) < LEAK / 10
    assert spare.self_discharge_per_day[LEAKY] == pytest.approx(LEAK, rel=0.1)


def test_two_cars_with_one_battery_share_nothing(tmp_path):
    """They drive in turns, each with a leaky cell of its own; the other car's sessions change no number."""
    make, files = SessionMaker(tmp_path / "sessions"), {"red": [], "blue": []}
    for day in range(6):
        car = ("red", "blue")[day % 2]
        soc = (0.8 if car == "red" else 0.6) - LEAK * day * (np.arange(96) == (LEAKY if car == "red" else WEAK))
        volts = CELL.ocv.voltage(soc) - CURRENT_A[:, None] * (0.002 if car == "red" else 0.0025)
        start_s = START_S + day * DAY_S
        files[car] += [make(TIME_S, CURRENT_A, volts, 25, start_s=start_s, metadata={"car": car})]
    lakes = {}
    for name, paths in (files | {"both": files["red"] + files["blue"]}).items():
        build_lake(LakeFolder(tmp_path / name), paths)
        lakes[name] = source(str(tmp_path / name)).histories()
    assert [history.car for history in lakes["both"]] == ["blue", "red"]
    for both, alone in zip(lakes["both"], lakes["blue"] + lakes["red"], strict=True):
        for name, value in vars(alone).items():
            if isinstance(value, np.ndarray):
                np.testing.assert_allclose(value, getattr(both, name), 1e-12, err_msg=name)
            else:
                assert value == getattr(both, name), name
    blue, red = lakes["both"]
    swaps = (Swap(START_S + 2.5 * DAY_S, (LEAKY,), car="red"), Swap(START_S + 2.5 * DAY_S, (WEAK,)))
    blue_after, red_after = source(str(tmp_path / "both"), swaps=swaps).histories()
    assert blue_after.is_present[:, LEAKY].all()  # it is red's module that was swapped
    assert red_after.is_present[:, LEAKY].tolist() == [False, False, True]
    assert blue_after.is_present[:, WEAK].tolist() == [False, True, True]  # the swap names no car
    assert red_after.is_present[:, WEAK].tolist() == [False, False, True]
    assert red.self_discharge_per_day[LEAKY] == pytest.approx(LEAK, rel=0.1)
    assert blue.self_discharge_per_day[WEAK] == pytest.approx(LEAK, rel=0.1)
    both = source(str(tmp_path / "both"))
    assert [history.car for history in both.histories("red")] == ["red"]
    with pytest.raises(ConfigError, match=r"car.*blue"):
        both.histories("green")
