"""`voltwall evidence` on the simulator over a pseudo-terminal: the simulator's own truth lies inside every band."""

import json

import pytest

from app.commands import evidence_benches
from app.service.simulator_control import SimulatorControl


class Judge(evidence_benches.SimulatedBench):
    """Asks the simulator before a fault is cleared what is true; what measures never sees it."""

    truth_s: dict = {}  # noqa: RUF012

    def repair(self, step):
        status = self._ask("status", {})
        (fault,) = status["active"]
        assert status["relays"] == "open"
        self.truth_s[step.name] = status["relays_since_s"] - fault["since_s"]
        super().repair(step)


@pytest.mark.timeout(180)
def test_the_truth_of_the_simulator_lies_inside_every_band(tmp_path, monkeypatch, voltwall):
    monkeypatch.setattr(evidence_benches, "SimulatedBench", Judge)
    page = tmp_path / "evidence.html"
    done = voltwall("evidence", "--data", str(tmp_path), "--html", str(page), "--json")
    assert done.returncode == 0, done.stderr
    evidence = json.loads(done.stdout)
    assert evidence["outcome"] == "passed"
    assert evidence["is_simulated"]
    assert evidence["coverage"]["is_enough"]
    for step in evidence["steps"]:
        timing = step["timing"]
        assert timing["low_s"] <= Judge.truth_s[step["name"]] <= timing["high_s"], step
        assert step["trip_fits"]
    again = voltwall("evidence", "--data", str(tmp_path), "--session", evidence["session_id"], "--html", str(page))
    assert again.returncode == 0
    assert "SIMULATED" in again.stdout


class Crew:
    """Answers the prompts as a person at the plug of a simulated master would."""

    def __init__(self, simulator):
        self._control = SimulatorControl()
        self._control.url = simulator.urls["control"]
        self._waiting = [None, {"fault": "lost-slave", "pack": 2}]

    def answer(self, prompt):
        if "why this step is skipped" not in prompt:
            self._control.ask("clear", {"fault": "lost-slave", "pack": 2})
        elif (fault := self._waiting.pop()) is None:
            return "no such plug on this bench"
        else:
            self._control.ask("inject", fault)
        return ""


def test_a_person_at_the_plug_pulls_it_or_says_why_not(simulator, tmp_path, monkeypatch, voltwall):
    scenario = tmp_path / "standing.toml"
    scenario.write_text(evidence_benches.SCENARIO)
    car = simulator("--serial", "tcp:0", "--control", str(tmp_path / "control"), "--scenario", str(scenario))
    monkeypatch.setattr("builtins.input", Crew(car).answer)
    page = tmp_path / "evidence.html"
    done = voltwall(
        "evidence", "--serial", car.urls["serial"], "--simulated", "--steps", "slave-lost,wire-lost",
        "--data", str(tmp_path / "data"), "--html", str(page), "--json",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    evidence = json.loads(done.stdout)
    assert (evidence["outcome"], evidence["is_simulated"]) == ("incomplete", True)
    steps = {step["name"]: step for step in evidence["steps"]}
    assert steps["slave-lost"]["verdict"] == "passed"
    assert (steps["wire-lost"]["verdict"], steps["wire-lost"]["skipped"]) == (
        "not-tested",
        "no such plug on this bench",
    )
    assert "no such plug on this bench" in page.read_text(encoding="utf-8")


def test_a_limit_beyond_the_rules_fails(tmp_path, monkeypatch, voltwall):
    monkeypatch.setattr(evidence_benches, "SCENARIO", evidence_benches.SCENARIO + "[config]\nt_cell_max = 65\n")
    done = voltwall(
        "evidence", "--data", str(tmp_path), "--html", str(tmp_path / "e.html"), "--steps", "slave-lost", "--json"
    )
    assert done.returncode == 1
    evidence = json.loads(done.stdout)
    assert evidence["outcome"] == "failed"
    assert {step["verdict"] for step in evidence["steps"]} == {"passed", "not-tested"}


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--steps", "spark"), "--steps"),
        (("--session", "none"), "none"),
        (("--serial", "bogus://x"), "serial"),
        (("--serial", "/dev/no-such-port"), "port not found"),
        (("--cell", "none.toml"), "cell"),
    ],
)
def test_what_cannot_be_tested_is_one_line(tmp_path, voltwall, words, says):
    done = voltwall("evidence", "--data", str(tmp_path), "--html", str(tmp_path / "e.html"), *words)
    assert done.returncode == 2
    assert says in done.stderr.splitlines()[-1]
