"""Accounts beside a running service: the command, a program with a token, every route against lower roles."""

import re

import pytest

CHIEF, ENGINEER = "chief password", "engineer password"
OPEN = {"/api/v1/health", "/api/v1/login", "/api/v1/me"}


@pytest.fixture(scope="module")
def guarded(make_module_service):
    return make_module_service(VOLTWALL_PASSWORD="shared password", VOLTWALL_VIEWER_PASSWORD="shared to read")


def accounts(voltwall, service, *words, **environment):
    return voltwall("accounts", *words, "--data", str(service.data), **environment)


def test_a_command_beside_the_service_lets_a_person_and_a_program_in(guarded, voltwall):
    added = accounts(voltwall, guarded, "add", "Erik", "--role", "engineer", VOLTWALL_ACCOUNT_PASSWORD=ENGINEER)
    assert (added.returncode, added.stdout) == (0, "Erik: engineer\n")
    assert (
        accounts(voltwall, guarded, "add", "cora", "--role", "chief", VOLTWALL_ACCOUNT_PASSWORD=CHIEF).returncode == 0
    )
    secret = accounts(voltwall, guarded, "token", "robot", "--role", "engineer", "--days", "2").stdout.strip()
    with guarded.client(headers={"Authorization": f"Bearer {secret}"}) as robot:
        assert robot.get("/me").json()["name"] == "robot (token)"
        robot.post("/identify")
        assert any(each["who"] == "robot (token)" for each in robot.get("/events").json()["events"])
        row = next(row for row in accounts(voltwall, guarded, "list").stdout.splitlines() if row.startswith("robot"))
        token_id = row.split()[2]
        assert accounts(voltwall, guarded, "revoke", token_id).returncode == 0
        assert robot.get("/events").status_code == 401
    with guarded.client(auth=("erik", ENGINEER)) as erik:
        assert erik.get("/me").json()["role"] == "engineer"
    assert accounts(voltwall, guarded, "remove", "nobody").returncode == 2
    assert accounts(voltwall, guarded, "remove", "cora").returncode == 2  # the last chief
    assert (
        accounts(voltwall, guarded, "add", "x", "--role", "viewer", VOLTWALL_ACCOUNT_PASSWORD="short").returncode == 2
    )


def test_no_route_gives_a_role_what_is_above_it(guarded):
    with guarded.client(auth=("eve", "shared to read")) as viewer, guarded.client() as stranger:
        paths = viewer.get("/openapi.json").json()["paths"]
        for path, methods in paths.items():
            place = re.sub(r"{\w+}", "1", path).removeprefix("/api/v1")
            for method in methods:
                if path.startswith("/api/") and path not in OPEN:
                    assert stranger.request(method, place).status_code == 401, (method, path)
                is_own = path.endswith(("/login", "/logout", "/me/password")) or "/logins/" in path
                if method != "get" and not is_own:
                    assert viewer.request(method, place).status_code == 403, (method, path)
