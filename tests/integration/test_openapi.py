"""Every operation of the OpenAPI document, asked with what it allows and with what it does not: never a 500.

Each answer must be declared: its media type, its shape, and where something is wrong a problem document. `make test`
asks one operation in three, the campaign all.
"""

import random
from collections.abc import Iterator

import pytest
import requests
from hypothesis import HealthCheck, Phase, assume, given, settings

from tests.campaign import campaign, of_size
from tests.service_process import WAIT_S

EVERY = of_size(3, 1, 1)  # one operation in three, in `make test`
N_EXAMPLES = of_size(1, 2, 100)  # examples that are allowed, and as many that are not
PROBLEM = "application/problem+json"
# A link that is down, or a master that does not answer, which the fuzzing may cause: the simulated cable is pulled, the
# master reset. Nothing else is an excuse for 503 or 504.
UNAVAILABLE = {f"urn:voltwall:{slug}" for slug in ("link-lost", "no-reply", "not-verified")}
CHOICE = "/api/v1/setup"
STUDY = "/api/v1/simulator/balancing"  # simulates for seconds; tests/unit/app/api/test_balancing.py asks it
FIRST_CHIEF = "/api/v1/accounts/{name}"  # from then on everybody has to log in
TIMEOUT_S = 30.0
MAX_REQUEST = 30_000  # what uvicorn takes as one request line


@pytest.fixture(scope="module")
def places(service) -> dict[str, list[str]]:
    """Values of path parameters that exist."""
    service.wait_for(lambda s: s["recording"] and s["recording"]["frames"] > 20)
    with service.client() as client:
        finished = client.get("/sessions").json()["sessions"][0]["id"]
        client.post(f"/sessions/{finished}/stop").raise_for_status()
        client.post("/sessions", json={}).raise_for_status()
        sessions = [session["id"] for session in client.get("/sessions").json()["sessions"]]
        events = [str(event["id"]) for event in client.get("/events?limit=3").json()["events"]]
    commands = ["fan-override", "set-soc", "can-send", "charge-stop", "clear-faults", "stream-start"]
    return {"session_id": sessions, "event_id": events, "name": commands}


def can_be_wrong(operation) -> bool:
    """Whether there is anything to get wrong; a text in the path, as the id of a session, may be any text."""
    kinds = [(parameter.location.name, parameter.definition["schema"]) for parameter in operation.iter_parameters()]
    return bool(list(operation.body)) or any(
        location != "PATH" or schema.get("type") != "string" for location, schema in kinds
    )


def operations(schema, mode) -> Iterator:
    """All that can be asked in a mode; those that disturb the simulated car last."""
    found = [result.ok() for result in schema.get_all_operations()]
    if mode.name == "NEGATIVE":
        found = [operation for operation in found if can_be_wrong(operation)]
    else:  # an allowed choice of what is read starts the service again
        found = [each for each in found if each.method != "put" or each.path not in (CHOICE, FIRST_CHIEF)]
        found = [each for each in found if each.path != STUDY]
    found.sort(key=lambda operation: "/simulator" in operation.path or operation.method == "delete")
    return iter(found[::EVERY])


def faults_of(operation, mode, session, places) -> dict[str, str]:
    """What is wrong with the answers, each with how to ask for it again."""
    from schemathesis.core.failures import FailureGroup
    from schemathesis.specs.openapi.checks import content_type_conformance, response_schema_conformance

    checks = [response_schema_conformance, content_type_conformance]
    found: dict[str, str] = {}
    chance = random.Random(operation.label)

    @settings(
        max_examples=N_EXAMPLES,
        deadline=None,
        derandomize=True,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(case=operation.as_strategy(generation_mode=mode))
    def ask(case):
        for name in set(case.path_parameters or ()) & places.keys():
            if chance.random() < 0.7:
                case.path_parameters[name] = chance.choice(places[name])
        if operation.method == "put" and chance.random() < 0.8:
            case.headers["If-Match"] = "*"
        assume(len(case.as_curl_command()) < MAX_REQUEST)
        try:
            answer = case.call(session=session, timeout=TIMEOUT_S)
        except requests.RequestException as error:
            found[f"cut off: {error}"[:200]] = case.as_curl_command()[:500]
            return
        if answer.status_code >= 400 and answer.headers["content-type"][0] != PROBLEM:
            found[f"{answer.status_code} is no problem document"] = case.as_curl_command()
        if answer.status_code >= 500 and answer.json()["type"] not in UNAVAILABLE:
            found[f"{answer.status_code}: {answer.text[:200]}"] = case.as_curl_command()
        try:
            case.validate_response(answer, checks=checks)
        except FailureGroup as error:
            found[str(error)[:500]] = case.as_curl_command()[:500]

    ask()
    return found


@campaign(240, 600, 1700)
@pytest.mark.parametrize("mode", ["positive", "negative"], ids=["allowed", "not allowed"])
def test_no_operation_fails_and_every_answer_is_declared(service, places, mode, tell):
    import schemathesis  # here: it takes a third of a second of every test process
    from schemathesis.generation import GenerationMode

    mode = GenerationMode(mode)
    schema = schemathesis.openapi.from_url(f"{service.base_url}/api/v1/openapi.json", timeout=WAIT_S)
    with requests.Session() as session:
        session.headers["Connection"] = "close"  # between two questions the service may close one that is kept open
        found = {operation.label: faults_of(operation, mode, session, places) for operation in operations(schema, mode)}
    faults = [f"{label}: {what}\n    {how}" for label, cases in found.items() for what, how in cases.items()]
    assert not faults, "\n".join(faults)
    assert len(found) > 40 / EVERY
    tell(f"schemathesis: {len(found)} operations, {N_EXAMPLES} examples each of what is {mode.value}, no fault")
