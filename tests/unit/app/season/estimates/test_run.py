"""A season estimated again: results survive a kill, are made once, and one bad session or process stops nothing."""

import shutil
from concurrent.futures import Future
from dataclasses import replace

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import format_cell, load_cell
from app.season.estimates.changes import changes
from app.season.estimates.results import Results, set_of
from app.season.estimates.run import Engine, estimate_season, open_engine
from app.season.estimates.session import EstimateJob, estimate_session
from app.season.tags import write_tags
from app.sessions.catalogue import Catalogue
from tests.recorded.arrays import SessionMaker

TEXT = format_cell(load_cell("samsung-25r-10p"))
LARGER = TEXT.replace("capacity_ah = 25", "capacity_ah = 20")
WANTED = [(set_of("own", None, "fused"), None)]


@pytest.fixture(scope="module")
def season(tmp_path_factory):
    """Three short drives, one of them without a SOC that was recorded."""
    folder = tmp_path_factory.mktemp("season")
    time_s = np.arange(0.0, 40.0, 0.1)
    current_a = np.where(np.sin(time_s) > 0.0, 60.0, 0.0)
    for k in range(3):
        soc = None if k == 2 else np.linspace(0.6, 0.5, len(time_s))
        SessionMaker(folder / "sessions")(
            time_s, current_a, 3.7 - 0.003 * current_a, soc=soc, start_s=1.79e9 + 86400 * k, cell_file=TEXT
        )
    return folder


def sessions(folder):
    return Catalogue(folder / "sessions").list()[::-1]


def engine(act=lambda _: None, window=1):
    """Runs each task at once; `act` may do something else instead."""

    def submit(function, job):
        future = Future()
        try:
            act(job)
            future.set_result(function(job))
        except Exception as error:  # noqa: BLE001 (as a worker does)
            future.set_exception(error)
        return future

    return Engine(submit, window)


def test_what_a_kill_left_is_kept_and_only_the_rest_is_estimated(season, tmp_path):
    results = Results(tmp_path)

    def killed(progress):
        if progress.done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        estimate_season(sessions(season), WANTED, "fused", results, engine(), killed)
    first = {result["session"]: result for result in results.read_all(WANTED[0][0])}
    half = results.folder / WANTED[0][0].id / ".half.json.1"
    half.write_text('{"half":')
    outcome = estimate_season(sessions(season), WANTED, "fused", results, engine())
    assert sorted(outcome.kept) == sorted(first)
    assert len(outcome.estimated) == 1
    every = {result["session"]: result for result in results.read_all(WANTED[0][0])}
    assert len(every) == 3
    assert {name: every[name] for name in first} == first


def test_tags_make_no_result_old_and_other_content_of_the_same_size_does(season, tmp_path):
    shutil.copytree(season / "sessions", tmp_path / "sessions")
    results, (info, *_) = Results(tmp_path), sessions(tmp_path)
    estimate_season([info], WANTED, "fused", results, engine())
    write_tags(info.path, {"tyres": "wet"}, t_wall_ns=1, who=None)
    (tagged, *_) = sessions(tmp_path)
    assert estimate_season([tagged], WANTED, "fused", results, engine()).kept == [info.id]
    other = sessions(season)[1]
    shutil.copy(other.path, info.path)
    again = replace(tagged, size_bytes=info.size_bytes)
    assert estimate_season([again], WANTED, "fused", results, engine()).kept == []


def test_a_damaged_result_is_made_again(season, tmp_path):
    results = Results(tmp_path)
    estimate_season(sessions(season)[:1], WANTED, "fused", results, engine())
    (path,) = (each for each in (results.folder / WANTED[0][0].id).glob("*.json") if each.name != "set.json")
    path.write_text(path.read_text()[:100])
    assert len(estimate_season(sessions(season)[:1], WANTED, "fused", results, engine()).estimated) == 1


def test_a_failed_session_does_not_stop_the_rest(season, tmp_path):
    bad = sessions(season)[1]

    def fail(job):
        if bad.id in job.path:
            raise OSError("the share is gone")

    told = []
    outcome = estimate_season(sessions(season), WANTED, "fused", Results(tmp_path), engine(fail), told.append)
    assert outcome.failed == {bad.id: "the share is gone"}
    assert len(outcome.estimated) == 2
    assert [each.done for each in told] == [1, 2, 3]
    assert told[-1].left_s == 0.0


def test_one_reading_makes_the_results_of_two_cell_files_and_says_what_changed(season, tmp_path):
    results, after = Results(tmp_path), set_of("smaller", LARGER, "fused")
    wanted = [(after, LARGER), *WANTED]
    estimate_season(sessions(season), wanted, "fused", results, engine())
    found = changes(results.read_all(WANTED[0][0]), results.read_all(after))
    assert len(found) == 3
    for each in found:
        assert each.capacity_before_ah > each.capacity_after_ah
        assert each.soc_before is not None
        assert each.soc_after != each.soc_before
    assert found[0].soc_recorded == pytest.approx(0.5, abs=0.01)
    assert found[2].soc_recorded is None
    assert results.find("smaller") == after


def test_resistance_is_told_over_the_cell_file_at_the_temperature_and_soc_of_the_moment(tmp_path):
    cell, time_s = load_cell("samsung-25r-10p"), np.arange(0.0, 120.0, 0.1)
    current_a = np.where(np.sin(time_s * 2.0) > 0.0, 80.0, 5.0)
    factor = np.linspace(1.0, 1.6, 96)
    ocv = float(cell.ocv.voltage(np.array([0.6]))[0])
    r0 = float(np.interp(0.6, cell.soc_grid, cell.r0_ohm[len(cell.r0_ohm) // 2]))
    volts = ocv - current_a[:, None] * r0 * factor
    path = SessionMaker(tmp_path)(time_s, current_a, volts, cell_file=TEXT)
    (result,) = estimate_session(EstimateJob(str(path), (None,)))
    told = np.array(result["resistance_factor"])
    assert np.corrcoef(told, factor)[0, 1] > 0.999
    assert told[-1] / told[0] == pytest.approx(1.6, rel=0.05)


def test_worker_processes_give_what_this_process_gives(season, tmp_path):
    results = Results(tmp_path)
    with open_engine("processes", 1) as pool:
        estimate_season(sessions(season)[:1], WANTED, "fused", results, pool)
    (found,) = results.read_all(WANTED[0][0])
    (here,) = estimate_session(EstimateJob(str(sessions(season)[0].path), (None,)))
    changing = {"processor_s", "process"}
    assert {k: v for k, v in found.items() if k not in changing} == {k: v for k, v in here.items() if k not in changing}
