from app.battery.shape import CELLS_PER_PACK, N_CELLS, N_PACKS, TEAM, Shape
from firmware_protocol import memory_map


def test_the_teams_battery_is_the_one_of_the_memory_map():
    assert (TEAM.n_packs, TEAM.cells_per_pack) == (memory_map.N_PACKS, memory_map.CELLS_PER_PACK)
    assert (memory_map.N_CELLS, TEAM.n_cells) == (N_CELLS, N_PACKS * CELLS_PER_PACK)


def test_cells_are_counted_over_all_segments():
    assert Shape(n_packs=5, cells_per_pack=20).n_cells == 100
