import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulator.errors import InputError
from simulator.shape import TEAM, Shape


@given(st.lists(st.integers(1, 40), min_size=1, max_size=20))
def test_places_and_indices_are_each_others_inverse(packs):
    shape = Shape(tuple(packs))
    places = [shape.place(cell) for cell in range(shape.n_cells)]
    assert [shape.cell_index(*place) for place in places] == list(range(shape.n_cells))
    assert places == [(p + 1, c + 1) for p, n in enumerate(packs) for c in range(n)]


@pytest.mark.parametrize(
    ("pack", "cell", "limit"),
    [
        (0, 1, "pack = 0 is outside 1..2"),
        (3, 1, "pack = 3 is outside 1..2"),
        (2, 5, "cell = 5 is outside 1..4 of pack 2"),
    ],
)
def test_a_place_that_is_none_is_refused_with_its_limit(pack, cell, limit):
    with pytest.raises(InputError, match=limit):
        Shape((12, 4)).cell_index(pack, cell)


def test_the_teams_own_has_eight_packs_of_twelve():
    assert (TEAM.n_packs, TEAM.n_cells, TEAM.cell_index(8, 12)) == (8, 96, 95)
