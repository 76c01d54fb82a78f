"""`voltwall season query` on the command line."""

import json

import pytest

from app.cli import main


@pytest.fixture
def query(lake, capsys):
    def run(*arguments: str) -> tuple[int, str, str]:
        status = main(["season", "query", "--lake", str(lake), *arguments])
        said = capsys.readouterr()
        return status, said.out, said.err

    return run


def test_without_a_question_they_are_listed(query):
    status, out, _ = query()
    assert status == 0
    assert "hot_laps" in out
    assert "--set degc=35" in out


def test_a_question_says_its_sql(query):
    assert "FROM laps" in query("hot_laps", "--show")[1]


def test_sql_is_answered_as_a_table_csv_and_json(query):
    sql = "SELECT lap, count(*) AS n FROM cells WHERE cell = 1 GROUP BY lap ORDER BY lap"
    assert query(sql)[1].splitlines()[:2] == ["lap  n", "0    2"]
    assert query(sql, "--csv")[1].splitlines() == ["lap,n", "0,2", "1,2", "2,2", "3,2"]
    assert json.loads(query(sql, "--json")[1]) == {
        "columns": ["lap", "n"],
        "rows": [[0, 2], [1, 2], [2, 2], [3, 2]],
        "is_cut": False,
    }


def test_what_was_cut_is_said(query):
    status, out, err = query("SELECT cell FROM cells", "--limit-rows", "2")
    assert (status, len(out.splitlines())) == (0, 3)
    assert "cut after 2 rows" in err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["weather"], "SQL, or one of"),
        (["hot_laps", "--set", "degc"], "NAME=VALUE"),
        (["hot_laps", "--set", "degc=warm"], "a number"),
        (["SELECT 1", "--limit-s", "0"], "limit-s = 0"),
        (["DELETE FROM cells"], "one SELECT"),
    ],
)
def test_what_is_wrong_is_one_line(query, arguments, said):
    status, _, err = query(*arguments)
    assert status == 2
    assert len(err.strip().splitlines()) == 1
    assert said in err


@pytest.mark.parametrize(
    ("name", "limit"),
    [
        ("file", "a folder or an fsspec URL"),
        ("file/below", "a folder or an fsspec URL"),
        ("none", "an existing folder"),
    ],
)
def test_a_lake_that_is_not_there_is_refused(tmp_path, capsys, name, limit):
    (tmp_path / "file").touch()
    place = tmp_path / name
    assert main(["season", "query", "--lake", str(place), "SELECT count(*) FROM sessions"]) == 2
    assert f"lake = {place}: {limit}" in capsys.readouterr().err
    assert not (tmp_path / "none").exists()
