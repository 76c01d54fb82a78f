"""Sessions of a recorder in the car brought over a link that breaks, from a real service."""

import hashlib
import shutil
import socket
import threading
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest

from app.errors import ConfigError
from app.sessions.errors import FetchFailed
from app.sessions.reading.reader import SessionFile
from app.sessions.transfer.fetch import Remote
from tests.service_process import WAIT_S


class BreakingLink:
    """A forwarder on a port of its own that cuts every connection after so many bytes of answers."""

    def __init__(self, target: str, cut_after: int) -> None:
        self._target = httpx.URL(target)
        self._cut_after = cut_after
        self.bytes = 0
        self.requests: list[bytes] = []
        self._server = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self._server.getsockname()[1]}"
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self._server.accept()
            except OSError:
                return
            self._serve(client)

    def _serve(self, client: socket.socket) -> None:
        host = f"{self._target.host}:{self._target.port}".encode()
        own = self.url.removeprefix("http://").encode()
        with client, socket.create_connection((self._target.host, self._target.port)) as upstream:
            request = client.recv(65536)
            self.requests.append(request)
            upstream.sendall(request.replace(own, host))
            left = self._cut_after
            while left > 0 and (data := upstream.recv(min(left, 65536))):
                client.sendall(data)
                left -= len(data)
                self.bytes += len(data)

    def close(self) -> None:
        self._server.close()


@contextmanager
def link(target: str, cut_after: int):
    forwarder = BreakingLink(target, cut_after)
    try:
        yield forwarder
    finally:
        forwarder.close()


@pytest.fixture(scope="module")
def car(service):
    """The URL of a service with a finished session, and that session."""
    service.wait_for(lambda s: s["recording"] and s["recording"]["frames"] > 60)
    with service.client() as client:
        session_id = client.get("/sessions").json()["sessions"][0]["id"]
        client.post(f"/sessions/{session_id}/stop")
        service.wait_for(lambda s: s["recording"] is None)
        found = next(s for s in client.get("/sessions").json()["sessions"] if s["id"] == session_id)
    assert found["closed"]
    yield service.base_url, session_id
    with service.client() as client:
        client.post("/sessions")


def remote_of(url: str) -> Remote:
    return Remote(url, label="car", sleep=lambda _: None)


def chosen(remote: Remote, session_id: str):
    return next(s for s in remote.sessions() if s.id == session_id)


def test_a_file_is_served_with_its_digest_and_in_ranges(car, tmp_path):
    url, session_id = car
    whole = httpx.get(f"{url}/api/v1/sessions/{session_id}/file", timeout=WAIT_S)
    assert whole.headers["ETag"].strip('"') == hashlib.sha256(whole.content).hexdigest()
    part = httpx.get(
        f"{url}/api/v1/sessions/{session_id}/file", headers={"Range": "bytes=1000-", "If-Range": whole.headers["ETag"]}
    )
    assert (part.status_code, part.content) == (206, whole.content[1000:])


def test_a_session_comes_over_a_link_that_breaks_and_no_byte_twice(car, tmp_path):
    url, session_id = car
    with link(url, 15_000) as broken:
        remote = remote_of(broken.url)
        with pytest.raises(FetchFailed):
            Remote(broken.url, label="car", sleep=stop_after(3)).fetch(chosen(remote_of(url), session_id), tmp_path)
        assert next(tmp_path.glob("*.part")).stat().st_size > 30_000
        progress = []
        path = remote.fetch(chosen(remote_of(url), session_id), tmp_path, lambda done, of: progress.append((done, of)))
    assert progress[-1][0] == progress[-1][1] == path.stat().st_size
    assert broken.bytes < path.stat().st_size + 3000 * len(broken.requests)
    assert path.name == f"car-{session_id}.sqlite"
    assert path.read_bytes() == httpx.get(f"{url}/api/v1/sessions/{session_id}/file", timeout=WAIT_S).content
    with SessionFile(path) as session:
        assert session.info.frames > 60
    assert sorted(each.suffix for each in tmp_path.iterdir()) == [".fetched", ".sqlite"]
    assert remote.is_fetched(chosen(remote_of(url), session_id), tmp_path)


def stop_after(pauses: int):
    """A sleep that gives up as somebody at the keyboard would."""
    left = iter(range(pauses))

    def sleep(_: float) -> None:
        if next(left, None) is None:
            raise FetchFailed("", "enough")

    return sleep


def test_a_part_of_another_file_is_begun_anew(car, tmp_path):
    url, session_id = car
    remote = remote_of(url)
    part = tmp_path / f"car-{session_id}.sqlite.part"
    part.write_bytes(b"of an older file")
    part.with_name(part.name + ".etag").write_text('"0123"')
    with SessionFile(remote.fetch(chosen(remote, session_id), tmp_path)) as session:
        assert session.problems() == []


def test_bytes_that_are_not_the_file_are_refused(car, tmp_path):
    url, session_id = car
    remote = remote_of(url)
    session = chosen(remote, session_id)
    etag = httpx.get(
        f"{url}/api/v1/sessions/{session_id}/file", headers={"Range": "bytes=0-0"}, timeout=WAIT_S
    ).headers["ETag"]
    part = tmp_path / f"car-{session_id}.sqlite.part"
    part.write_bytes(b"damaged on the way")
    part.with_name(part.name + ".etag").write_text(etag)
    with pytest.raises(FetchFailed, match="the download is corrupt"):
        remote.fetch(session, tmp_path)
    remote.fetch(session, tmp_path)


def test_what_cannot_be_a_recorder_is_named(car, tmp_path):
    with pytest.raises(ConfigError, match="url = car"):
        Remote("car")
    with pytest.raises(FetchFailed, match=r"refused|reset"):
        Remote("http://127.0.0.1:1", sleep=lambda _: None).sessions()
    shutil.rmtree(tmp_path)
    remote = Remote(car[0], sleep=lambda _: None)
    assert remote.local_id(chosen(remote, car[1])) == f"127-0-0-1-{car[1]}"
    assert Path(remote.fetch(chosen(remote, car[1]), tmp_path)).is_file()
