"""`voltwall evidence` on the simulator over a pseudo-terminal: the simulator's own truth lies inside every band."""

import json

import pytest

from app.commands import evidence as command
from app.commands.guided.benches import SimulatedBench


class Judge(SimulatedBench):
    """Asks the simulator before a fault is cleared what is true; what measures never sees it."""

    truth_s: dict = {}  # noqa: RUF012

    def mend(self, step):
        status = self._ask("status", {})
        (fault,) = status["active"]
        assert status["relays"] == "open"
        self.truth_s[step.name] = status["relays_since_s"] - fault["since_s"]
        super().mend(step)


@pytest.mark.timeout(180)
def test_the_truth_of_the_simulator_lies_inside_every_band(tmp_path, monkeypatch, voltwall):
    monkeypatch.setattr(command, "SimulatedBench", Judge)
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


def test_a_limit_beyond_the_rules_fails(tmp_path, monkeypatch, voltwall):
    monkeypatch.setattr(command, "SCENARIO", command.SCENARIO + "[config]\nt_cell_max = 65\n")
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
        (("--serial", "/dev/no-such-port"), "no such port"),
        (("--cell", "none.toml"), "cell"),
    ],
)
def test_what_cannot_be_tested_is_one_line(tmp_path, voltwall, words, says):
    done = voltwall("evidence", "--data", str(tmp_path), "--html", str(tmp_path / "e.html"), *words)
    assert done.returncode == 2
    assert says in done.stderr.splitlines()[-1]
