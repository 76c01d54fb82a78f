"""The season over HTTP; the processes that answer are tests of the lake's."""

import pytest

from app.season.store.store import QueryFailed
from app.words import Message


@pytest.fixture
def asked(monkeypatch) -> list:
    """What was asked; answered without a process."""
    found = []

    def query(self, question, given):
        found.append((question, given))
        if question == "wrong":
            raise QueryFailed(Message("one-select"))
        return {"columns": ["a", "b"], "rows": [[1, None]], "is_cut": False}

    monkeypatch.setattr("app.season.season_lake.SeasonLake.query", query)
    return found


def test_the_questions_are_told_with_their_sql(client, tmp_path):
    body = client.get("/api/v1/season/questions").json()
    assert body["lake"] == str(tmp_path / "lake")
    by_name = {each["name"]: each for each in body["questions"]}
    assert by_name["hot_laps"]["parameters"] == [
        {"name": "degc", "default": "35", "meaning": "temperature limit in degrees Celsius"},
        {"name": "car", "default": "", "meaning": "name of the car; empty for all cars"},
    ]
    assert "FROM cells" in by_name["ranking"]["sql"]


def test_an_answer_has_columns_and_rows(client, asked):
    answer = client.post("/api/v1/season/query", json={"question": "hot_laps", "parameters": {"degc": "30"}})
    assert asked == [("hot_laps", {"degc": "30"})]
    assert answer.json().items() >= {"columns": ["a", "b"], "rows": [[1, None]], "is_cut": False}.items()


@pytest.mark.parametrize(
    "body",
    [{"question": ""}, {"question": "a\x00b"}, {"question": "x", "parameters": {"a=b": "1"}}, {"question": "wrong"}],
)
def test_a_wrong_question_names_its_field(client, asked, body):
    answer = client.post("/api/v1/season/query", json=body)
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["field"]
