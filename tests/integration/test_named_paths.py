"""Requests that name a file where a port, a bus or a battery is expected: refused, and the file unchanged."""

from pathlib import Path

import pytest

from app.sources.connections import FILE
from tests.service_process import Service
from tests.unit.app.sources.test_connections import DBC, PROFILE

BUNDLED = Path("app/battery/bundled").resolve()


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    made = Service(tmp_path_factory.mktemp("service"), []).start()
    yield made
    made.stop()


@pytest.fixture
def victim(service):
    path = service.data / "victim.toml"
    path.write_bytes(PROFILE)
    (service.data / "two.dbc").write_bytes(DBC)
    yield path
    assert path.read_bytes() == PROFILE
    assert not (service.data / FILE).exists(), "nothing was chosen"


SERIAL = ["spy:///dev/null?file={victim}", "{victim}", "alt://{victim}?class=Serial", "/dev/../{victim}", "file.sqlite"]
CAN = [
    "slcan:spy:///dev/null?file={victim}",
    "slcan:{victim}",
    "serial:{victim}",
    "virtual:a?file={victim}",
    "usb2can:1?dll={victim}",
]


def requests(victim):
    for url in SERIAL:
        yield "POST", "/setup/check-link", {"serial": url.format(victim=victim)}
        yield "PUT", "/setup", {"serial": url.format(victim=victim)}
    for url in CAN:
        bus = url.format(victim=victim)
        yield "POST", "/setup/check-link", {"can": bus}
        yield "PUT", "/setup", {"can": bus}
        yield "PUT", "/setup", {"can": f"virtual:a,{bus}"}
        yield "POST", "/setup/profile-drafts", {"can": bus, "files": {"a.dbc": DBC.decode()}, "seconds": 0.5}
    for battery in (victim, BUNDLED / "team.toml", "../team", "/dev/zero", "/etc/passwd"):
        yield "PUT", "/setup", {"battery": str(battery)}
    for name in ("dbc", "include", "cell"):
        text = PROFILE.decode().replace('dbc = "two.dbc"', f'dbc = "{victim.with_name("two.dbc")}"')
        if name == "include":
            text = f'include = "{victim}"\n[battery]\nname = "mine"\n'
        if name == "cell":
            text = PROFILE.decode().replace("[battery]", f'[battery]\ncell = "{victim}"')
        yield "POST", "/setup/batteries", {"files": {"mine.toml": text, "two.dbc": DBC.decode()}}


def test_no_request_opens_a_file_of_the_service(service, victim):
    with service.client() as client:
        for method, path, body in requests(victim):
            answer = client.request(method, path, json=body)
            assert answer.status_code == 422, f"{method} {path} {body}: {answer.status_code} {answer.text}"
            assert victim.read_bytes() == PROFILE, f"{method} {path} {body}"
        assert client.get("/health").status_code == 200


def test_an_import_names_a_bundled_battery_or_uploads(service, victim):
    hostile = PROFILE.replace(b'"two.dbc"', f'"{victim.with_name("two.dbc")}"'.encode())
    with service.client() as client:
        csv = b"time_s,v_1\n" + b"".join(b"%d,3.7\n" % i for i in range(20))
        made = client.post("/imports", content=csv, params={"filename": "a.csv"})
        assert made.status_code in (200, 201), made.text
        refused = client.post(f"/imports/{made.json()['id']}", json={"battery": str(victim)})
        assert refused.status_code == 422, refused.text
        profile = client.post("/imports", content=hostile, params={"filename": "mine.toml"}).json()["id"]
        refused = client.post(f"/imports/{made.json()['id']}", json={"battery_uploads": [profile]})
        assert refused.status_code == 422, refused.text
        assert "own folder" in refused.text
