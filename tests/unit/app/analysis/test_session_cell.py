"""The cell file of then, where the session keeps one."""

from app.analysis.session_cell import cell_of, judged_by, unlike
from app.estimation.cell_model.cell_file import DEFAULT_CELL, format_cell, load_cell
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.recorder import Recorder
from firmware_protocol.config_image import default_image
from firmware_protocol.memory_map import CONFIG
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


def test_what_judges_a_session_is_told(tmp_path):
    with SessionFile(recorded(tmp_path, format_cell(load_cell()))) as session:
        codes = [each.code for each in judged_by(session)]
        chosen = [each.code for each in judged_by(session, "lco-pouch")]
    assert codes == ["report-versions", "report-limits-unknown", "report-cell-of-then"]
    assert chosen == ["report-versions", "report-limits-unknown", "judged-cell-chosen"]


def test_two_sessions_are_unlike_by_cell_file_and_by_every_limit_that_differs(make_session):
    image = bytearray(default_image())
    CONFIG["t_cell_max"].pack_into(image, (55,))
    same, other = format_cell(load_cell()), format_cell(load_cell("sanyo-ur18650w"))
    first, second = (
        make_session([0.0, 1.0], [0.0, 0.0], cell_file=cell_file, config=config)
        for cell_file, config in ((same, None), (other, bytes(image)))
    )
    with SessionFile(first) as a, SessionFile(second) as b:
        assert unlike(a, a) == []
        found = unlike(a, b)
    assert [each.code for each in found] == ["unlike-cells", "unlike-limit"]
    assert found[1].args["name"] == "t_cell_max"
