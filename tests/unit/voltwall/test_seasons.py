import shutil

import pytest

import voltwall


def test_a_season_answers_sql_with_parameters(lake):
    with voltwall.season(lake) as season:
        table = season.sql("SELECT DISTINCT car FROM cells WHERE cell < $below ORDER BY car", below=3)
    assert table.rows() == [{"car": "built-in-master-96-cells"}, {"car": "e-26-simulated"}]
    assert len(table) == 2


def test_a_data_folder_stands_for_its_lake(lake):
    season = voltwall.season(lake.parent)
    assert season.lake == str(lake)
    assert str(lake) in repr(season)


def test_questions_are_asked_by_name(lake):
    season = voltwall.season(lake)
    assert season.questions["hot_laps"].startswith("Laps in which")
    assert len(season.ask("hot_laps", degc=21.5)) == 4
    frame = pytest.importorskip("pandas") and season.ask("lowest_voltage").to_pandas()
    assert frame["voltage_min_v"].min() == pytest.approx(3.4, abs=1e-4)


def test_cars_are_named_and_told_apart(lake):
    season = voltwall.season(lake)
    assert season.cars == ["built-in-master-96-cells", "e-26-simulated"]
    every = season.ask("ranking").rows()
    assert [row["car"] for row in every] != [season.cars[0]] * len(every)
    one = season.ask("ranking", car=season.cars[0]).rows()
    assert one == [row for row in every if row["car"] == season.cars[0]]
    assert len(one) == 96


def test_a_lake_is_built_from_sessions(season, tmp_path):
    shutil.copytree(season, tmp_path / "sessions")
    (tmp_path / "sessions" / "broken.sqlite").write_bytes(b"no session")
    lake = voltwall.season(tmp_path / "lake")
    said = lake.build(tmp_path)
    assert list(said.values()).count("made") == 2
    assert "database" in said["broken"]
    assert lake.sql("SELECT count(*) AS n FROM sessions").rows() == [{"n": 2}]


def test_what_is_no_select_is_refused(lake):
    with pytest.raises(voltwall.VoltwallError, match="one SELECT"):
        voltwall.season(lake).sql("DROP TABLE cells")
