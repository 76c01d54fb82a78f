import numpy as np
import pytest

from app.sessions.storage.signals import default_signals, find_signal
from firmware_protocol.memory_map import FIELDS, element_name


def test_every_element_of_the_memory_map_has_a_name_that_finds_it() -> None:
    for name, field in FIELDS.items():
        for element in range(field.count):
            signal = find_signal(element_name(field, element))
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
        ("v_min", 0, 0.0),
        ("estimate.soc[3]", 50000, 1.0),
        ("estimate.soc_sigma[3]", 65535, np.nan),
    ],
)
def test_counts_become_units_and_what_is_missing_has_no_value(name: str, count: int, expected: float) -> None:
    assert find_signal(name).physical(np.array([count]))[0] == pytest.approx(expected, nan_ok=True)


def test_the_default_signals_exist_and_are_unique() -> None:
    names = default_signals()
    assert len(set(names)) == len(names) == len({find_signal(name).name for name in names})
