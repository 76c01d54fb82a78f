"""The cell file of then, where the session keeps one."""

from app.analysis.session_cell import cell_of
from app.estimation.cell_model.cell_file import DEFAULT_CELL, format_cell, load_cell
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.recorder import Recorder
from tests.fake_clock import FakeClock


def recorded(folder, cell_file):
    recorder = Recorder(folder, FakeClock(), version="1.0", cell_file=cell_file)
    path = recorder.start().path
    recorder.close()
    return path


def test_a_session_is_judged_with_the_cell_it_was_recorded_with(tmp_path):
    other = load_cell("sanyo-ur18650w")
    with SessionFile(recorded(tmp_path, format_cell(other))) as session:
        cell, is_of_then = cell_of(session)
    assert is_of_then
    assert cell.capacity_ah == other.capacity_ah


def test_a_session_without_one_or_with_an_unreadable_one_is_judged_with_todays(tmp_path):
    for text in (None, "no cell file"):
        with SessionFile(recorded(tmp_path, text)) as session:
            cell, is_of_then = cell_of(session)
        assert not is_of_then
        assert cell.name == load_cell(DEFAULT_CELL).name
