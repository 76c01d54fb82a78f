"""A cell's index becomes pack and number of the battery that is spoken of."""

import threading
from dataclasses import asdict

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.battery.battery import Battery
from app.words import Cell, Message, message_from_json, name_cells_by, naming_cells, render
from app.words.places import TEAM, place_of

SEGMENTS = st.lists(st.integers(1, 30), min_size=1, max_size=20)


@given(SEGMENTS, st.data())
def test_a_cell_is_at_its_place_in_the_battery(segments: list[int], data: st.DataObject) -> None:
    cell = data.draw(st.integers(0, sum(segments) - 1))
    segment, place = Battery("x", tuple(segments)).place(cell)
    with naming_cells(segments):
        assert Cell(cell) == Cell(cell, segment + 1, place + 1)
        assert render(Message("at-cell", cell=Cell(cell))).endswith(f"pack {segment + 1}, cell {place + 1}")


def test_nothing_named_is_the_teams_own() -> None:
    assert (Cell(36).pack, Cell(36).cell) == (4, 1)


def test_the_place_of_a_message_stays_where_it_is_read() -> None:
    with naming_cells([18, 20]):
        kept = asdict(Message("cell-at", cell=Cell(19)))
    assert message_from_json(kept).args["cell"] == Cell(19, 2, 2)


def test_a_message_of_an_earlier_version_is_the_teams() -> None:
    with naming_cells([18, 20]):
        assert message_from_json({"code": "x", "args": {"cell": {"index": 19}}}).args["cell"] == Cell(19, 2, 8)


@pytest.mark.parametrize(("index", "place"), [(38, (3, 1)), (57, (3, 20)), (58, (4, 1))])
def test_beyond_the_last_cell_packs_go_on(index: int, place: tuple[int, int]) -> None:
    assert place_of(index, [18, 20]) == place


def test_the_battery_of_the_process_holds_in_all_threads() -> None:
    found: list[Cell] = []
    try:
        name_cells_by([2, 2])
        thread = threading.Thread(target=lambda: found.append(Cell(3)))
        thread.start()
        thread.join()
        with naming_cells([4]):
            assert Cell(3) == Cell(3, 1, 4)
        assert found == [Cell(3, 2, 2)]
    finally:
        name_cells_by(TEAM)
