"""`voltwall drill`: the product by itself on a simulator process, and a crew at the console of a running service."""

import json

import pytest

from app.analysis.drill.days import draw_days
from app.commands import drill as command


@pytest.mark.timeout(180)
def test_the_product_is_scored_on_the_days_of_a_seed(voltwall):
    days = {n: draw_days(n, 1)[0] for n in range(1000)}
    seed = min((n for n, day in days.items() if day.fault == "lost-slave"), key=lambda n: days[n].at_s)
    done = voltwall("drill", "--product", "--seed", str(seed), "--days", "1", "--pass", "1", "--json")
    assert done.returncode == 0, done.stdout + done.stderr
    debrief = json.loads(done.stdout)
    (day,) = debrief["days"]
    assert (day["fault"], day["answer"]["fault"], day["answer"]["pack"]) == ("lost-slave", "lost-slave", day["pack"])
    assert debrief["points"] == debrief["most"] == 3
    assert 0 <= day["visible_s"] < 5
    assert day["said"]


def test_a_crew_answers_on_the_console(make_service, voltwall, monkeypatch):
    service = make_service()
    answers = iter(["no such fault", "lost-slave", "9", "3", "18"])
    monkeypatch.setattr(command, "input", lambda _: next(answers), raising=False)
    done = voltwall("drill", "--url", service.base_url, "--seed", "3", "--days", "2")
    assert done.returncode == 0, done.stderr
    assert "day 1" in done.stdout
    assert "seed 3: you have" in done.stdout
    with service.client() as client:
        assert client.get("/simulator/drill").json()["is_on"] is False


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--seed", "-1"), "--seed"),
        (("--url", "http://127.0.0.1:9"), "no voltwall service"),
        (("--product", "--cell", "none.toml"), "cell"),
    ],
)
def test_what_cannot_be_drilled_is_one_line(voltwall, words, says):
    done = voltwall("drill", *words)
    assert done.returncode == 2
    assert says in done.stderr.splitlines()[-1]
