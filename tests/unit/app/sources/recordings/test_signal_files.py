from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.sources.recordings.csv_table import TableUnreadable
from app.sources.recordings.profile import guess
from app.sources.recordings.signal_files import read_signals
from app.sources.recordings.table import load_table
from tests.campaign import examples


def test_the_groups_of_a_foreign_mf4_come_at_the_times_of_the_quickest(tmp_path: Path) -> None:
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version="4.10") as file:
        quick, slow = np.arange(0.0, 2.0, 0.5), np.array([0.4, 1.4])
        file.append([asammdf.Signal(np.array([1.0, 2.0, 3.0, 4.0]), quick, name="PackCurrent", unit="A")])
        cells = [asammdf.Signal(np.array([3.6, 3.7]), slow, name=f"Cell{n}_V", unit="V") for n in (1, 2)]
        file.append(cells)
        file.save(tmp_path / "run.bin.mf4")
    table = load_table((tmp_path / "run.bin.mf4").rename(tmp_path / "run.bin"))
    np.testing.assert_allclose(np.diff(table.columns["time_s"]), 0.5)
    np.testing.assert_array_equal(table.columns["Cell1_V (V)"], [np.nan, 3.6, 3.6, 3.7])
    profile = guess(table)
    assert (profile.current, profile.voltages) == ("PackCurrent (A)", "Cell{n}_V (V)")


@pytest.mark.parametrize("kind", ["mcap", "ld"])  # asammdf complains when it is collected
def test_a_file_that_only_begins_as_one_is_refused_by_name(tmp_path: Path, kind: str) -> None:
    magic = {"mcap": b"\x89MCAP0\r\n", "ld": b"\x40" + bytes(7)}[kind]
    (tmp_path / "cut").write_bytes(magic + bytes(20))
    with pytest.raises(TableUnreadable, match="cut: "):
        load_table(tmp_path / "cut")


@settings(max_examples=examples(30))
@given(st.binary(max_size=400))
def test_any_bytes_are_an_ld_or_a_reason(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "any.ld"
    path.write_bytes(content)
    with suppress(TableUnreadable):
        read_signals(path, "ld")
