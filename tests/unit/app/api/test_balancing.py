"""The balancing study over HTTP: the command's figures, curves over one time, its refusals by field."""

from concurrent.futures import ThreadPoolExecutor

import pytest

STUDY = "/api/v1/simulator/balancing"
SMALL = {"thesis": True, "rate": 3}


@pytest.fixture(scope="module")
def client(make_module_client):
    return make_module_client()


def test_a_charge_of_the_thesis_has_its_figures_beside_and_curves_over_one_time(client):
    told = client.get(STUDY, params=SMALL | {"circuit": ["transformer", "none"]}).json()
    assert told["command"] == "voltwall balance --circuit=transformer --circuit=none --thesis --rate=3.0"
    driven, alone = told["circuits"]
    assert (driven["name"], alone["name"]) == ("transformer", "none")
    assert driven["thesis"] == {"hours": 1.41, "max_degc": 29.1, "soc_difference_percent": 0.0644}
    assert alone["thesis"] is None
    assert driven["soc_difference"] < alone["soc_difference"] / 2
    for run in told["circuits"]:
        for curve in ("soc_spread", "temperature_max_degc", "charger_a"):
            assert len(run[curve]) == len(told["time_h"])
            ended = [t > run["hours"] for t in told["time_h"]]
            assert [value is None for value in run[curve]] == ended
        assert max(run["temperature_max_degc"][:2]) <= run["max_degc"]
    assert told["time_h"][-1] == max(run["hours"] for run in told["circuits"])


@pytest.mark.parametrize(
    ("query", "field", "limit"),
    [
        ({"rate": 7}, "rate", "0.05 to 6 C"),
        ({"spread": -1}, "spread", "0 to 50 percent"),
        ({"packs": 30, "cells": 30}, "n_packs x per_pack", "1 to 600 cells"),
        ({"rest": True, "rate": 1}, "rate", "a rest takes no charging current"),
        ({"circuit": "magnets"}, "circuit.0", "passive"),
        ({"packs": 0}, "packs", "1"),
        ({"temperature": "nan"}, "temperature", "finite"),
        ({"volts": 1}, "volts", ""),
    ],
)
def test_what_the_simulation_does_not_take_is_refused_by_field_and_limit(client, query, field, limit):
    answer = client.get(STUDY, params=query)
    assert answer.status_code == 422, answer.text
    (error,) = answer.json()["errors"]
    assert field in error["field"]
    assert limit in error["message"]["text"]


def test_studies_run_one_at_a_time_so_that_a_process_is_left_for_reports(client):
    with ThreadPoolExecutor(2) as threads:
        both = [threads.submit(client.get, STUDY, params=SMALL | {"circuit": "none"}) for _ in range(2)]
    second, first = sorted((each.result() for each in both), key=lambda answer: -answer.status_code)
    assert (first.status_code, second.status_code) == (200, 409)
    assert second.json()["detail"] == "another balancing simulation is running: try again when it has finished"
    assert client.get(STUDY, params=SMALL | {"circuit": "none"}).status_code == 200
