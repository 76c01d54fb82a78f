"""One request, one answer, each a line of JSON; whatever else comes back is a lost link."""

import json
import socket
import threading

import pytest

from app.errors import LinkError
from app.service.simulator_control import SimulatorControl, SimulatorRefused


@pytest.fixture
def answering(tmp_path):
    """A control whose simulator gives one answer, and the request that it got."""
    listener = socket.create_server(("127.0.0.1", 0))
    (tmp_path / "token").write_text("secret\n", encoding="utf-8")
    control, asked, threads = SimulatorControl(), [], []
    control.url = f"tcp:{listener.getsockname()[1]} token:{tmp_path / 'token'}"

    def answer(raw: bytes):
        def serve() -> None:
            connection, _ = listener.accept()
            with connection:
                asked.append(json.loads(connection.makefile().readline()))
                connection.sendall(raw)

        threads.append(threading.Thread(target=serve))
        threads[-1].start()
        return control, asked

    yield answer
    for thread in threads:
        thread.join(5)
    listener.close()


def test_an_answer_comes_without_its_ok_and_the_request_carries_the_token(answering):
    control, asked = answering(b'{"ok": true, "speed": 2}\n')
    assert control.ask("speed", {"speed": 2, "for_s": None}) == {"speed": 2}
    assert asked == [{"do": "speed", "speed": 2, "token": "secret"}]


def test_a_refusal_carries_the_simulators_own_words(answering):
    control, _ = answering(b'{"ok": false, "error": "no such fault"}\n')
    with pytest.raises(SimulatorRefused, match="no such fault"):
        control.ask("inject")


@pytest.mark.parametrize("raw", [b"", b"no json\n", b"[1]\n"])
def test_what_is_no_answer_is_a_lost_link(answering, raw):
    control, _ = answering(raw)
    with pytest.raises(LinkError):
        control.ask("state")


def test_before_the_simulator_has_started_there_is_no_link():
    with pytest.raises(LinkError, match="starting"):
        SimulatorControl().ask("state")


def test_a_simulator_that_is_gone_does_not_answer(tmp_path):
    control = SimulatorControl()
    control.url = f"unix:{tmp_path / 'none'}"
    with pytest.raises(LinkError, match="no response from the simulator"):
        control.ask("state")
