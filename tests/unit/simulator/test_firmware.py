"""The library that the simulated master is: refused in one line where it is missing or made of other sources."""

import pytest

from simulator import firmware
from simulator.cli import main
from simulator.errors import FirmwareError


@pytest.fixture
def unloaded():
    firmware.load.cache_clear()
    yield
    firmware.load.cache_clear()


def test_a_missing_or_outdated_library_is_refused(monkeypatch, tmp_path, unloaded):
    monkeypatch.setattr(firmware, "sources", list)
    with pytest.raises(FirmwareError, match="other sources"):
        firmware.load()
    monkeypatch.setattr(firmware, "LIBRARY", tmp_path / "vw_firmware.so")
    with pytest.raises(FirmwareError, match=r"^the library vw_firmware\.so is missing: install voltwall again"):
        firmware.load()


def test_a_simulation_without_it_says_so_in_one_line(monkeypatch, tmp_path, unloaded, capsys):
    monkeypatch.setattr(firmware, "LIBRARY", tmp_path / "vw_firmware.so")
    assert main(["--duration", "1"]) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert said.startswith("voltwall simulate: the library vw_firmware.so is missing: install voltwall again")
