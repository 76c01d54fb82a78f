"""Commands that cannot work now are named with the reason, as the master's firmware would decide."""

from dataclasses import replace

import pytest

from app.configuration.command_conditions import BALANCING, block_reasons
from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import make_estimator
from app.live.pipeline import Pipeline
from app.sources.master.source import MasterSource

CELL = load_cell("samsung-25r-10p")
STARTS = {"charge-start", *BALANCING}


@pytest.fixture
def snapshot(master):
    estimator = make_estimator("coulomb", CELL, 96)
    chain = Pipeline(MasterSource("serial"), lambda: estimator, filter_name="c", cell_name="c")
    return chain.feed(master.frame()).snapshot


@pytest.fixture
def reasons(snapshot):
    """Return the codes for a state of the car."""

    def of(state="idle", *, fit=True, charging="off", age_s=0.1, current_a=0.0):
        changed = replace(
            snapshot,
            master=replace(snapshot.master, state=state, fit=fit),
            charger=replace(snapshot.charger, state=charging),
            accumulator=replace(snapshot.accumulator, current_a=current_a),
            age_s=replace(snapshot.age_s, status=age_s),
        )
        return {name: why.code for name, why in block_reasons(changed).items()}

    return of


def test_at_rest_only_a_charging_that_is_not_there_cannot_be_stopped(reasons):
    assert reasons() == {"charge-stop": "blocked-not-charging"}
    assert reasons(charging=None) == {}  # whether it charges is not known


@pytest.mark.parametrize("age_s", [None, 12.0])
def test_nothing_is_started_on_a_silent_car_and_everything_can_be_stopped(reasons, age_s):
    found = reasons("drive", age_s=age_s)
    assert found == dict.fromkeys((*STARTS, "soc-from-ocv"), "blocked-silent")
    assert {name: why.code for name, why in block_reasons(None).items()} == found


@pytest.mark.parametrize(
    ("state", "fit", "charging", "code"),
    [
        ("drive", True, "off", "blocked-driving"),
        ("charge", True, "constant_current", "blocked-charging"),
        ("fault", False, "fault", "blocked-fault"),
        ("charge", False, "constant_current", "blocked-fault"),
    ],
)
def test_nothing_is_started_while_the_car_drives_charges_or_holds_a_fault(reasons, state, fit, charging, code):
    found = reasons(state, fit=fit, charging=charging)
    assert {found[name] for name in STARTS} == {code}
    assert ("charge-stop" in found) == (state != "charge")


def test_a_driving_car_is_not_reset_and_gives_no_voltage_at_rest(reasons):
    found = reasons("drive", current_a=147.0)
    assert (found["reset"], found["soc-from-ocv"]) == ("blocked-driving", "blocked-current")
    assert "reset" not in reasons("drive", age_s=None)
