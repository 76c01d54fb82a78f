import pytest

from simulator.relays import PRECHARGE_LIMIT_S, Relays, RelayState
from tests.c_master import CRelays

DRIVE = {"is_ok": True, "drive_requested": True, "charging": False}


@pytest.fixture(params=[Relays, CRelays], ids=["python", "c"])
def make(request) -> type[Relays] | type[CRelays]:
    """The relays of the virtual master, and those in C."""
    return request.param


def test_vehicle_is_connected_when_its_link_is_precharged(make):
    relays = make()
    assert relays.step(0.0, link_share=0.0, **DRIVE) is RelayState.PRECHARGE
    assert relays.step(0.9, link_share=0.949, **DRIVE) is RelayState.PRECHARGE
    assert relays.step(0.92, link_share=0.951, **DRIVE) is RelayState.VEHICLE
    opened = relays.step(5.0, is_ok=False, drive_requested=True, charging=False, link_share=1.0)
    assert opened is RelayState.OPEN


def test_charger_is_connected_without_precharge_and_never_with_the_vehicle(make):
    relays = make()
    assert relays.step(0.0, is_ok=True, drive_requested=True, charging=True, link_share=0.0) is RelayState.CHARGER
    assert relays.step(0.1, link_share=0.0, **DRIVE) is RelayState.PRECHARGE
    assert relays.step(0.2, is_ok=True, drive_requested=False, charging=False, link_share=0.5) is RelayState.OPEN


def failed(make) -> Relays | CRelays:
    relays = make()
    relays.step(0.0, link_share=0.0, **DRIVE)
    assert relays.step(PRECHARGE_LIMIT_S, link_share=0.94, **DRIVE) is RelayState.OPEN
    assert relays.has_precharge_failed
    return relays


def test_a_precharge_that_fails_is_not_repeated_by_itself(make):
    relays = failed(make)
    assert {relays.step(4.0 + k, link_share=1.0, **DRIVE) for k in range(10)} == {RelayState.OPEN}


def test_a_failed_precharge_is_tried_again_when_the_driver_asks_anew_or_faults_are_cleared(make):
    relays = failed(make)
    relays.step(5.0, is_ok=True, drive_requested=False, charging=False, link_share=0.0)
    assert relays.step(6.0, link_share=0.0, **DRIVE) is RelayState.PRECHARGE
    relays = failed(make)
    relays.retry()
    assert relays.step(6.0, link_share=0.0, **DRIVE) is RelayState.PRECHARGE


def test_a_failed_precharge_does_not_keep_the_charger_off(make):
    assert failed(make).step(5.0, is_ok=True, drive_requested=True, charging=True, link_share=0.0) is RelayState.CHARGER
