"""What a server that is not a Voltwall service, or a hostile one, can make of a fetch: an error, and nothing more."""

import errno
import json
import os
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from app.clock import Clock
from app.sessions.catalogue import Catalogue
from app.sessions.errors import FetchFailed
from app.sessions.recording.recorder import Recorder
from app.sessions.transfer.fetch import Remote
from app.sessions.transfer.fetch_jobs import FetchJobs
from tests.fake_clock import FunctionClock
from tests.http_stub import Answer, Asked, http_stub

LISTED = {"id": "s1", "name": "run", "started": 1.0, "duration_s": 1.0, "bytes": 3, "recording": False}
Answers = dict[str, Answer]  # by the end of the path


class Server:
    """Answers with what stands in `answers`; keeps what was asked."""

    def __init__(self) -> None:
        self.url = ""
        self.answers: Answers = {}
        self.authorizations: list[str | None] = []

    def answer(self, asked: Asked) -> Answer:
        self.authorizations.append(asked.headers.get("Authorization"))
        return self.answers[asked.path.rsplit("/", 1)[-1]]


@pytest.fixture
def serve() -> Iterator[Callable[[], Server]]:
    with ExitStack() as servers:

        def start() -> Server:
            server = Server()
            server.url = servers.enter_context(http_stub(server.answer))
            return server

        yield start


def listing(text: str) -> Answer:
    return 200, {}, text.encode()


def failed_once(folder, remote: Remote) -> str:
    """Start a job in the service; return how it ended."""
    told: list[str] = []
    ended = threading.Event()

    def note(severity: str, code: str, text: object) -> None:
        told.append(code)
        ended.set()

    jobs = FetchJobs(folder, Catalogue(folder), note, Clock())
    jobs.start(remote, [], fill=True)
    assert ended.wait(10), "the job has not ended"
    assert not jobs.state().is_running
    jobs.start(remote, [], fill=True)  # it can be started again
    return told[0]


@pytest.mark.parametrize("size", ["1e999", "-1e999", '"many"', "{}", "null"])
def test_a_list_that_is_none_is_named_and_the_job_ends(serve, tmp_path, size):
    server = serve()
    entry = json.dumps(LISTED).replace('"bytes": 3', f'"bytes": {size}')
    server.answers["sessions"] = listing('{"sessions": [' + entry + "]}")
    with pytest.raises(FetchFailed, match="not a Voltwall service"):
        Remote(server.url).sessions()
    assert failed_once(tmp_path, Remote(server.url)) == "fetch-failed"


@pytest.mark.parametrize("pieces", ["-1", "1000001", "2.5", '"many"', "null"])
def test_a_number_of_pieces_that_no_session_has_is_refused(serve, pieces):
    server = serve()
    offer = '{"id": "a", "pieces": 0, "bytes": 1, "started": 1.0, "recording": false}'
    server.answers["pieces"] = listing('{"sessions": [' + offer.replace('"pieces": 0', f'"pieces": {pieces}') + "]}")
    head = {"id": "a", "name": "", "voltwall": "1", "map_hash": "", "metadata": {}, "start_mono_ns": 0,
            "start_wall_ns": 0, "closed": True, "recording": False, "pieces": 0, "bytes": 1, "frames": 0,
            "can_frames": 0, "battery_files": []}  # fmt: skip
    server.answers["head"] = listing(json.dumps(head))
    assert Remote(server.url).head("a")["pieces"] == 0
    server.answers["head"] = listing(json.dumps(head).replace('"pieces": 0', f'"pieces": {pieces}'))
    with pytest.raises(FetchFailed, match="not a Voltwall service"):
        Remote(server.url).offers()
    with pytest.raises(FetchFailed, match="not a Voltwall service"):
        Remote(server.url).head("a")


def test_a_list_without_end_in_depth_is_refused(serve):
    server = serve()
    server.answers["sessions"] = listing("[" * 200_000)
    with pytest.raises(FetchFailed, match="not a Voltwall service"):
        Remote(server.url).sessions()


def test_a_list_that_comes_byte_by_byte_ends(serve):
    server = serve()
    server.answers["sessions"] = listing(json.dumps({"sessions": [LISTED]}))
    assert [session.id for session in Remote(server.url).sessions()] == ["s1"]
    clock_s = iter((0.0, 121.0))
    with pytest.raises(FetchFailed, match="no response within 120 s"):
        Remote(server.url, monotonic_s=lambda: next(clock_s)).sessions()


@pytest.mark.parametrize("headers", [{"Repr-Digest": "sha-256=:A=AA:"}, {"Content-Length": "three"}])
def test_a_digest_or_length_that_is_none_ends_the_fetch(serve, tmp_path, headers):
    server = serve()
    server.answers |= {"sessions": listing(json.dumps({"sessions": [LISTED]})), "file": (200, headers, b"abc")}
    remote = Remote(server.url, sleep=lambda _: None)
    with pytest.raises(FetchFailed):
        remote.fetch(remote.sessions()[0], tmp_path)
    assert failed_once(tmp_path, remote) == "fetch-failed"


def test_the_password_does_not_go_to_another_server(serve):
    named, other = serve(), serve()
    named.answers["sessions"] = (302, {"Location": f"{other.url}/api/v1/sessions"}, b"")
    other.answers["sessions"] = listing('{"sessions": []}')
    with pytest.raises(FetchFailed, match="sends us on to 127"):
        Remote(named.url, password="of the car").sessions()
    assert named.authorizations[0] is not None
    assert other.authorizations == []


def test_a_redirect_within_the_server_is_followed(serve):
    server = serve()
    server.answers = {"sessions": (302, {"Location": "/api/v1/all"}, b""), "all": listing('{"sessions": []}')}
    assert Remote(server.url, password="of the car").sessions() == []
    assert server.authorizations[0] == server.authorizations[1] is not None


def session_of(folder: Path, began_s: int) -> bytes:
    """The file of a recorder whose clock showed so much at the start."""
    recorder = Recorder(folder, FunctionClock(lambda: began_s * 10**9, lambda: 10**18), version="1")
    recorder.start("run", {})
    recorder.close()
    (path,) = folder.glob("*.sqlite")
    return path.read_bytes()


def test_two_recorders_behind_one_label_do_not_overwrite_each_other(serve, tmp_path):
    red, blue = (session_of(tmp_path / str(began_s), began_s) for began_s in (5, 7))
    server = serve()
    server.answers["sessions"] = listing(json.dumps({"sessions": [LISTED]}))

    def fetched(body: bytes, label: str) -> bytes:
        server.answers["file"] = (200, {}, body)
        remote = Remote(server.url, label=label)
        return remote.fetch(remote.sessions()[0], tmp_path / "here").read_bytes()

    for _ in range(2):  # the same one again is no other
        assert fetched(red, "car") == red
    with pytest.raises(FetchFailed, match="another recorder has this label"):
        fetched(blue, "car")
    assert (tmp_path / "here" / "car-s1.sqlite").read_bytes() == red
    assert fetched(blue, "blue") == blue


def test_a_service_that_is_not_there_is_told_in_the_words_of_the_system() -> None:
    with socket.socket() as taken:  # nobody listens on it
        taken.bind(("127.0.0.1", 0))
        url = f"http://127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(FetchFailed) as refused:
            Remote(url).sessions()
    assert str(refused.value) == f"{url}: {os.strerror(errno.ECONNREFUSED)}"
