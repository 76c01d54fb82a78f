"""The simulator's control port: whatever a client sends, it is answered in JSON, and the simulation goes on."""

import json
import math
import selectors
import socket
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from simulator.control import Control
from simulator.control_server import MAX_REQUEST, ControlServer
from simulator.fault_kinds import FAULTS
from simulator.library import find_scenario
from simulator.runner import Runner
from simulator.scenario_player import ScenarioPlayer
from tests.campaign import examples


@pytest.fixture(scope="module", params=["unix", "tcp"])
def port(request, tmp_path_factory):
    """Send a line, return the answer; on TCP the token is added where the line is an object."""
    player = ScenarioPlayer(find_scenario("skid-pad"))
    runner = Runner(player.simulation)
    where = str(tmp_path_factory.mktemp("control") / "port") if request.param == "unix" else "0"
    selector = selectors.DefaultSelector()
    server = ControlServer(where, Control(player, runner))
    server.open(selector)
    place, _, token = server.url.partition(" token:")
    family = socket.AF_UNIX if request.param == "unix" else socket.AF_INET
    address = where if request.param == "unix" else ("127.0.0.1", int(place.partition(":")[2]))

    def ask(line, *, known=True):
        if token and known and isinstance(line, dict):
            line = line | {"token": Path(token).read_text()}
        raw = json.dumps(line).encode() if isinstance(line, dict) else line
        with socket.socket(family) as client:
            client.settimeout(5)
            client.connect(address)
            client.sendall(raw + b"\n")
            answer = b""
            while not answer.endswith(b"\n"):
                for key, _ in selector.select(5):
                    key.data()
                client.setblocking(False)
                try:
                    part = client.recv(1 << 20)
                except BlockingIOError:
                    continue
                if not part:
                    return None
                answer += part
        for key, _ in selector.select(0.1):
            key.data()
        return json.loads(answer)

    yield ask
    server.close()
    selector.close()


VALUES = (
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.lists(st.integers(), max_size=2)
)
KEYS = st.sampled_from(("value", "fault", "pack", "cell", "for_s", "token", "sensor"))
BOLT = {"do": "inject", "fault": "joint-resistance-high", "pack": 1, "cell": 1}
REQUESTS = st.builds(
    lambda do, rest: rest | {"do": do},
    st.sampled_from(("status", "faults", "scenarios", "inject", "clear", "clear-all", "speed", "next", "unplug"))
    | VALUES,
    st.dictionaries(KEYS, VALUES | st.sampled_from(sorted(FAULTS)), max_size=5),
) | st.builds(lambda rest: BOLT | rest, st.dictionaries(st.sampled_from(("pack", "cell", "value", "for_s")), VALUES))


@given(request=REQUESTS)
@example(request={"do": "speed", "value": 5e-324})
@example(request=BOLT | {"pack": math.inf})
@example(request=BOLT | {"pack": math.nan})
@example(request=BOLT | {"cell": -math.inf})
@example(request=BOLT | {"value": 10**400})
@example(request=BOLT | {"value": math.nan})
@example(request=BOLT | {"for_s": math.inf})
@example(request={"do": "next"})
@settings(max_examples=examples(120))
def test_any_request_is_answered(port, request):
    assert port(request)["ok"] in (True, False)


@given(line=st.binary(max_size=200).map(lambda raw: raw.replace(b"\n", b"")))
@example(line=b"[" * (MAX_REQUEST - 1))
@example(line=b'{"do":"inject","fault":"joint-resistance-high","pack":1e400,"cell":1}')
@example(line=b'{"do":"inject","fault":"joint-resistance-high","pack":NaN,"cell":1}')
@example(line=b'{"do":"inject","fault":"current-sensor-offset","value":' + b"9" * 401 + b"}")
@example(line=b'{"a":' * 800)
@settings(max_examples=examples(60))
def test_any_line_is_answered_or_refused(port, line):
    answer = port(line)
    assert answer is not None
    assert answer["ok"] is False


@pytest.mark.parametrize("token", ["ø", "\ud800", 7, None])
def test_a_token_that_is_no_ascii_is_refused(port, token):
    answer = port({"do": "status", "token": token}, known=False)
    assert answer["ok"] in (True, False)
