from simulator.bms_state import RelayState
from tests.c_master import CRelays

PRECHARGE_LIMIT_S = 3.0  # `VW_PRECHARGE_LIMIT_MS`
DRIVE = {"is_ok": True, "drive_requested": True, "charging": False}


def test_vehicle_is_connected_when_its_link_is_precharged():
    relays = CRelays()
    assert relays.step(0.0, link_share=0.0, **DRIVE) is RelayState.PRECHARGE
    assert relays.step(0.9, link_share=0.949, **DRIVE) is RelayState.PRECHARGE
    assert relays.step(0.92, link_share=0.951, **DRIVE) is RelayState.VEHICLE
    opened = relays.step(5.0, is_ok=False, drive_requested=True, charging=False, link_share=1.0)
    assert opened is RelayState.OPEN


def test_charger_is_connected_without_precharge_and_never_with_the_vehicle():
    relays = CRelays()
    assert relays.step(0.0, is_ok=True, drive_requested=True, charging=True, link_share=0.0) is RelayState.CHARGER
    assert relays.step(0.1, link_share=0.0, **DRIVE) is RelayState.PRECHARGE
    assert relays.step(0.2, is_ok=True, drive_requested=False, charging=False, link_share=0.5) is RelayState.OPEN


def failed() -> CRelays:
    relays = CRelays()
    relays.step(0.0, link_share=0.0, **DRIVE)
    assert relays.step(PRECHARGE_LIMIT_S, link_share=0.94, **DRIVE) is RelayState.OPEN
    assert relays.has_precharge_failed
    return relays


def test_a_precharge_that_fails_is_not_repeated_by_itself():
    relays = failed()
    assert {relays.step(4.0 + k, link_share=1.0, **DRIVE) for k in range(10)} == {RelayState.OPEN}


def test_a_failed_precharge_is_tried_again_when_the_driver_asks_anew_or_faults_are_cleared():
    relays = failed()
    relays.step(5.0, is_ok=True, drive_requested=False, charging=False, link_share=0.0)
    assert relays.step(6.0, link_share=0.0, **DRIVE) is RelayState.PRECHARGE
    relays = failed()
    relays.retry()
    assert relays.step(6.0, link_share=0.0, **DRIVE) is RelayState.PRECHARGE


def test_a_failed_precharge_does_not_keep_the_charger_off():
    assert failed().step(5.0, is_ok=True, drive_requested=True, charging=True, link_share=0.0) is RelayState.CHARGER
