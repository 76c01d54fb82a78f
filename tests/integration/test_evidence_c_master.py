"""`voltwall evidence` on the C reference over a pseudo-terminal: its own truth lies inside every band."""

import json
import random
import subprocess
import threading
import time

import pytest

from app.commands.guided import benches
from tests.c_programs import build_program

FAULTS = {
    "voltage-high": "v 30 50000",
    "voltage-low": "v 31 9000",
    "current-high": "i 30000",
    "current-low": "i -30000",
    "temperature-high": "t 40 80",
    "temperature-low": "t 41 -40",
    "slave-lost": "slave 2",
}


class CrewAtTheCMaster:
    """Answers the prompts as a person would, and writes down what the master says is true."""

    def __init__(self, folder):
        self.link = folder / "c-master"
        self.process = subprocess.Popen(
            [build_program("host"), "--serial", self.link, "--faults"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert self.process.stdout.readline() == "ready\n"
        self.truth_s = {}
        self._steps = iter(FAULTS.items())
        self._step, self._fault_us = "", 0
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        self._rng = random.Random(5)

    def answer(self, prompt):
        """Pull or put back a plug."""
        if "why this step is skipped" not in prompt:
            self._say("clear")
        elif (step := next(self._steps, None)) is None:
            return "no such plug on this bench"
        else:
            self._step, fault = step
            time.sleep(self._rng.random() / 20)  # another phase each time
            self._say(fault)
        return ""

    def stop(self):
        """Switch it off."""
        self.process.stdin.close()
        self.process.terminate()
        self.process.wait(10)
        self._reader.join(10)
        self.process.stdout.close()
        self.process.stderr.close()

    def _say(self, line):
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def _read(self):
        for line in self.process.stderr:
            what, _, at_us = line.partition(" ")
            if what == "open":
                self.truth_s[self._step] = (int(at_us) - self._fault_us) / 1e6
            elif what == "fault":
                self._fault_us = int(at_us)


@pytest.fixture
def crew(tmp_path):
    crew = CrewAtTheCMaster(tmp_path)
    yield crew
    crew.stop()


@pytest.mark.timeout(180)
def test_the_truth_of_the_c_master_lies_inside_every_band(crew, tmp_path, monkeypatch, voltwall):
    monkeypatch.setattr(benches.PersonAtThePlug.__init__, "__defaults__", (crew.answer,))
    done = voltwall(
        "evidence", "--serial", str(crew.link), "--simulated", "--temperature-cycle", "0.02",
        "--data", str(tmp_path / "data"), "--html", str(tmp_path / "evidence.html"), "--json",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    evidence = json.loads(done.stdout)
    assert evidence["outcome"] == "incomplete"
    assert evidence["is_simulated"]
    for step in evidence["steps"]:
        if step["name"] in FAULTS:
            timing = step["timing"]
            assert step["verdict"] == "passed"
            assert step["trip_fits"]
            assert timing["low_s"] <= crew.truth_s[step["name"]] <= timing["high_s"], step
        else:
            assert (step["verdict"], step["skipped"]) == ("not-tested", "no such plug on this bench")
    assert "no such plug on this bench" in (tmp_path / "evidence.html").read_text(encoding="utf-8")
