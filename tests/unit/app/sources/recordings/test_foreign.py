"""Files of other systems: each is read with its own header, by content, with nothing said about it."""

from pathlib import Path

import numpy as np
import pytest

from app.sources.recordings.battery_log import battery_log
from app.sources.recordings.dataset import load_recording
from app.sources.recordings.guess import guess
from app.sources.recordings.table import load_table

FOREIGN = Path(__file__).parent / "foreign"


@pytest.mark.parametrize(
    ("name", "length_s", "cells", "charged_a"),  # the last row's current, positive on discharge
    [
        ("arbin.csv", 271.2135, 1, -2.650138),
        ("archive.csv", 20.0, 1, -0.55),
        ("basytec.txt", 61.2359273, 1, -0.449601734),
        ("bdf.csv", 70960.0, 1, -0.006055158),
        ("biologic.mpt", 0.7, 1, None),
        ("date_stamp.csv", 1.5, 1, 1.3),
        ("digatron.csv", 68520.0, 1, -0.5),
        ("diybms.csv", 40.0, 3, None),
        ("leafspy.csv", 20.0, 96, 14.5),
        ("maccor.csv", 14.06, 1, -28.798),
        ("maccor.txt", 90.88, 1, 0.49996),
        ("neware_flat.csv", 121.0, 1, -0.1),
        ("neware_layers.csv", 600.0, 1, 0.5),
        ("novonix.csv", 78.83, 1, -0.49999133),
        ("orion.csv", 0.4, 12, 16.3),
        ("pec.csv", 19.998, 1, None),
        ("vesc.csv", 0.2, 1, 12.1),
    ],
)
def test_a_file_of_another_system_imports_as_it_is(
    name: str, length_s: float, cells: int, charged_a: float | None
) -> None:
    table = load_table(FOREIGN / name)
    log = battery_log(table, guess(table))
    assert log.time_s[-1] == pytest.approx(length_s, abs=0.01)
    assert log.voltages_v.shape[1] == cells
    assert 2.5 < np.nanmin(log.voltages_v) <= np.nanmax(log.voltages_v) < 4.3
    if charged_a is not None:
        assert log.current_a[-1] == pytest.approx(charged_a)


@pytest.mark.parametrize("name", ["arbin.csv", "biologic.mpt", "digatron.csv", "maccor.txt", "pec.csv"])
def test_a_test_of_one_cell_is_read_the_same_by_the_estimator(name: str) -> None:
    table = load_table(FOREIGN / name)
    profile = guess(table)
    log = battery_log(table, profile)
    recording = load_recording(FOREIGN / name, charge_positive=profile.charge_positive)
    np.testing.assert_allclose(np.unique(recording.current_a), np.unique(log.current_a))
    assert recording.time_s[-1] - recording.time_s[0] == pytest.approx(log.time_s[-1])
