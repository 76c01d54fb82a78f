import numpy as np
import pytest

from app.sessions.errors import UnknownSignal
from app.sessions.storage.signals import Signals
from app.sources.loaded_battery import load_battery, team_battery
from firmware_protocol.memory_map import FIELDS, element_name

TEAM = Signals(team_battery())


def test_every_element_of_the_memory_map_has_a_name_that_finds_it() -> None:
    for name, field in FIELDS.items():
        for element in range(field.count):
            signal = TEAM.find(element_name(field, element))
            assert (signal.field, signal.element, signal.unit, signal.scale) == (name, element, field.unit, field.scale)


@pytest.mark.parametrize(
    ("name", "count", "expected"),
    [
        ("v[0]", 0, np.nan),
        ("v[0]", 36123, 3.6123),
        ("t[95]", -128, np.nan),
        ("t[95]", -5, -5.0),
        ("slave[7].cvr[11]", 65535, np.nan),
        ("i_fs", -12345, -123.45),
        ("v_min", 0, np.nan),
        ("estimate.soc[3]", 50000, 1.0),
        ("estimate.soc_sigma[3]", 65535, np.nan),
    ],
)
def test_counts_become_units_and_what_is_missing_has_no_value(name: str, count: int, expected: float) -> None:
    assert TEAM.find(name).physical(np.array([count]))[0] == pytest.approx(expected, nan_ok=True)


def test_the_default_signals_exist_and_are_unique() -> None:
    names = [signal.name for signal in TEAM.of_table()]
    assert len(set(names)) == len(names)
    assert [TEAM.find(name).name for name in names] == names


def test_a_battery_with_a_dbc_has_the_signals_of_its_cells_and_sensors() -> None:
    signals = Signals(load_battery("foxbms-2"))
    assert signals.of_field("v")[1] == signals.of_field("t")[1] == signals.of_field("estimate.soc")[1] == 216
    assert signals.of_field("sensor")[1] == 180
    assert signals.find("v[215]").element == 215
    assert signals.find("i_fs").unit == "A"
    for beyond in ("v[216]", "conf.ts", "slave[0].cvr[0]", "sensor[180]", "state.closed"):
        with pytest.raises(UnknownSignal):
            signals.find(beyond)
