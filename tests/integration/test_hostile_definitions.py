"""No DBC and no profile that a request carries stops the service: each is read in time that grows with its length."""

import pytest

from tests.service_process import Service

BLANKS = " " * 200_000
DBC = f'VERSION ""\nBU_: BMS\nBO_ 256 Cells: 8 BMS\n SG_ a{BLANKS}b\n SG_ V1 : 0|16@1+ (0.001,0) [0|5] "V" X\n'
TITLE = "[" + BLANKS + "x\n"
STARS = "*a" * 14 + "*b"
PROFILE = (
    '[battery]\nname = "x"\nsegments = [1]\n[source]\ndbc = "x.dbc"\n[[source.voltage]]\n'
    'signal = "{signal}"\nbase = 1\n'
)


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    service = Service(tmp_path_factory.mktemp("data"), []).start()
    yield service
    service.stop()


def answer(service, method, path, **content):
    """The status of a request, after which the service is well."""
    with service.client() as client:
        status = client.request(method, path, **content).status_code
        client.get("/health").raise_for_status()
        return status


def files(dbc=DBC, signal="V{cell}"):
    return {"x.toml": PROFILE.replace("{signal}", signal), "x.dbc": dbc}


HOSTILE = {
    name.replace("x.toml", "stars.toml"): text for name, text in files(DBC.replace("V1", "a" * 120), STARS).items()
}


@pytest.mark.parametrize(
    ("method", "path", "content", "status"),
    [
        ("POST", "/can/dbc", {"content": DBC}, 200),
        ("POST", "/setup/profile-drafts", {"json": {"files": {"x.dbc": DBC}}}, 200),
        ("POST", "/setup/batteries", {"json": {"files": files()}}, 201),
        ("POST", "/setup/batteries", {"json": {"files": HOSTILE}}, 422),
        ("POST", "/setup/batteries", {"json": {"files": {**files(), "x.toml": TITLE}}}, 422),
    ],
    ids=["can-dbc", "learn", "battery", "stars", "title"],
)
def test_a_hostile_definition_is_answered(service, method, path, content, status):
    assert answer(service, method, path, **content) == status


def test_a_hostile_correction_is_answered(service):
    with service.client() as client:
        draft = client.post("/setup/profile-drafts", json={"files": {"x.dbc": DBC}}).json()["id"]
        answer = client.post(f"/setup/profile-drafts/{draft}", json={"profile": TITLE[:200_000]})
        assert answer.status_code == 200
        assert answer.json()["checks"]


def test_a_hostile_battery_in_the_data_folder_is_not_chosen(service):
    folder = service.data / "batteries" / "stars"
    folder.mkdir(parents=True)
    for name, text in HOSTILE.items():
        (folder / name).write_text(text)
    with service.client() as client:
        assert {"team", "foxbms-2"} <= {each["id"] for each in client.get("/setup").json()["batteries"]}
        assert client.put("/setup", json={"battery": str(folder / "stars.toml")}).status_code == 422
        client.get("/health").raise_for_status()
