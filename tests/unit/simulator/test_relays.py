from simulator.relays import PRECHARGE_S, Relays, RelayState


def test_vehicle_is_precharged_before_it_is_connected():
    relays = Relays()
    wants = {"is_ok": True, "drive_requested": True, "charging": False}
    assert relays.step(0.0, **wants) is RelayState.PRECHARGE
    assert relays.step(PRECHARGE_S - 0.02, **wants) is RelayState.PRECHARGE
    assert relays.step(PRECHARGE_S, **wants) is RelayState.VEHICLE
    assert relays.step(5.0, is_ok=False, drive_requested=True, charging=False) is RelayState.OPEN


def test_charger_is_connected_without_precharge_and_never_with_the_vehicle():
    relays = Relays()
    assert relays.step(0.0, is_ok=True, drive_requested=True, charging=True) is RelayState.CHARGER
    assert relays.step(0.1, is_ok=True, drive_requested=True, charging=False) is RelayState.PRECHARGE
    assert relays.step(9.0, is_ok=True, drive_requested=False, charging=False) is RelayState.OPEN
