import json
import math
import selectors
import socket
import stat
from pathlib import Path

import pytest

from simulator.control import Control
from simulator.control_server import MAX_REQUEST, ControlServer
from simulator.library import find_scenario
from simulator.runner import Runner
from simulator.scenario_player import ScenarioPlayer


@pytest.fixture
def player() -> ScenarioPlayer:
    return ScenarioPlayer(find_scenario("skid-pad"))


@pytest.fixture
def control(player) -> Control:
    return Control(player, Runner(player.simulation))


def test_inject_and_clear_name_cells_as_people_do(control, player):
    assert control.answer({"do": "inject", "fault": "joint-resistance-high", "pack": 3, "cell": 7, "value": 2}) == {
        "ok": True,
        "fault": "joint-resistance-high",
    }
    assert player.simulation.accumulator.extra_joint_ohm[30] == pytest.approx(2e-3)
    active = control.answer({"do": "status"})["active"]
    assert active == [
        {"fault": "joint-resistance-high", "value": 2.0, "since_s": 0.0, "until_s": None, "pack": 3, "cell": 7}
    ]
    assert control.answer({"do": "clear", "fault": "joint-resistance-high", "pack": 3, "cell": 7})["ok"]
    assert control.answer({"do": "status"})["active"] == []


def test_catalogue_is_enough_to_build_a_form(control):
    faults = control.answer({"do": "faults"})["faults"]
    assert {"fault", "meaning", "target", "unit", "minimum", "maximum", "default"} <= set(faults[0])
    for fault in faults:
        places = {"none": {}, "pack": {"pack": 1}, "cell": {"pack": 1, "cell": 1}}[fault["target"]]
        for_s = None if fault["is_instant"] else 5
        request = {"do": "inject", "fault": fault["fault"], "value": fault["default"], "for_s": for_s, **places}
        assert control.answer(request) == {"ok": True, "fault": fault["fault"]}, fault


BOLT = {"do": "inject", "fault": "joint-resistance-high", "pack": 3, "cell": 7}


@pytest.mark.parametrize(
    ("request_", "reason"),
    [
        ({}, "`do` is one of"),
        ({"do": "explode"}, "`do` is one of"),
        ({"do": []}, "`do` is one of"),
        ({"do": "inject"}, "fault is missing"),
        ({"do": "inject", "fault": "joint-resistance-high"}, "needs pack and cell"),
        (BOLT | {"cell": 13}, "cell = 13 is outside the whole numbers 1..12"),
        (BOLT | {"cell": 1.5}, "cell = 1.5 is outside"),
        (BOLT | {"pack": math.inf}, "pack = inf is outside the whole numbers 1..8"),
        (BOLT | {"pack": math.nan}, "pack = nan is outside"),
        (BOLT | {"value": 10**400}, "is outside 0..50 mohm"),
        (BOLT | {"vlaue": 2}, "'vlaue' means nothing to 'inject'"),
        (BOLT | {"for_s": math.inf}, "for_s = inf is outside 0..100000000 s"),
        ({"do": "inject", "fault": "current-sensor-offset", "value": "much"}, "value = 'much' is no number"),
        ({"do": "inject", "fault": "current-sensor-offset", "value": True}, "value = True is no number"),
        ({"do": "inject", "fault": "current-sensor-offset", "pack": 1}, "needs neither pack nor cell"),
        ({"do": "inject", "fault": "slave-lost", "pack": 1, "cell": 1}, "needs pack"),
        ({"do": "inject", "fault": "master-watchdog-reset", "for_s": 5}, "for_s means nothing"),
        (
            {"do": "clear", "fault": "joint-resistance-high", "pack": 3, "cell": 7, "value": 2},
            "'value' means nothing to 'clear'",
        ),
        ({"do": "status", "pack": 3}, "'pack' means nothing to 'status'"),
        ({"do": "speed", "value": 0}, "value = 0 is outside 0.01..1000"),
        ({"do": "speed", "value": 1e-300}, "outside 0.01..1000"),
        ({"do": "speed", "value": math.nan}, "outside 0.01..1000"),
        ({"do": "speed"}, "value is missing"),
        ({"do": "unplug"}, "for_s is missing"),
        ({"do": "unplug", "for_s": -1}, "for_s = -1 is outside 0..3600 s (0 left out)"),
    ],
)
def test_requests_that_make_no_sense_are_refused_with_key_and_limit(control, player, request_, reason):
    answer = control.answer(request_)
    assert answer["ok"] is False
    assert reason in answer["error"]
    assert player.faults.active == ()


def test_next_goes_on_to_the_next_phase():
    player = ScenarioPlayer(find_scenario("race-day"))
    control = Control(player, Runner(player.simulation))
    assert control.answer({"do": "status"})["phase"] == "endurance"
    control.answer({"do": "next"})
    assert control.answer({"do": "status"})["phase"] == "rest"


def test_next_after_the_end_is_refused(control, player):
    assert control.answer({"do": "next"})["ok"]
    assert player.is_over
    assert control.answer({"do": "next"}) == {"ok": False, "error": "the scenario is over"}


class Client:
    """A client whose server runs in this thread."""

    def __init__(self, server: ControlServer, client: socket.socket) -> None:
        self.server = server
        self.client = client
        client.settimeout(5)

    def says(self, line: bytes, selector: selectors.BaseSelector) -> dict[str, object] | None:
        self.client.sendall(line)
        self.client.setblocking(False)
        for _ in range(200):
            for key, _ in selector.select(0.05):
                key.data()
            try:
                data = self.client.recv(1 << 16)
            except BlockingIOError:
                continue
            except ConnectionResetError:
                return None
            return json.loads(data) if data else None
        raise AssertionError("no answer")


def test_unix_socket_answers_and_is_closed_to_others(control, tmp_path):
    path = tmp_path / "control"
    selector = selectors.DefaultSelector()
    server = ControlServer(str(path), control)
    server.open(selector)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    with socket.socket(socket.AF_UNIX) as raw:
        raw.connect(str(path))
        client = Client(server, raw)
        assert client.says(b'{"do": "status"}\n', selector)["scenario"] == "skid-pad"
        assert client.says(b"not json\n", selector)["ok"] is False
        assert client.says(b"[]\n", selector)["ok"] is False
        assert client.says(b"x" * (MAX_REQUEST + 1), selector) is None
    server.close()
    assert not path.exists()


def test_tcp_wants_the_token_of_the_file(control):
    selector = selectors.DefaultSelector()
    server = ControlServer("0", control)
    server.open(selector)
    port, token_file = server.url.removeprefix("tcp:").split(" token:")
    assert stat.S_IMODE(Path(token_file).stat().st_mode) == 0o600
    token = Path(token_file).read_text()
    with socket.create_connection(("127.0.0.1", int(port))) as raw:
        client = Client(server, raw)
        assert client.says(b'{"do": "status"}\n', selector)["ok"] is False
        assert client.says(b'{"do": "status", "token": "wrong"}\n', selector)["ok"] is False
        assert client.says(json.dumps({"do": "status", "token": token}).encode() + b"\n", selector)["ok"] is True
    server.close()
    assert not Path(token_file).exists()
