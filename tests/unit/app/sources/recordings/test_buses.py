"""A log of two buses: one is read, or the log is refused where an id is on both."""

import can
import pytest

from app.errors import ImportFailed
from app.sources.recordings.buses import Buses
from app.sources.recordings.can_log import read_frames

FRAMES = [(0.0, "can0", 0x100, b"\1"), (0.1, "can1", 0x100, b"\2"), (0.2, "can1", 0x200, b"\3")]


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "two.log"
    lines = (f"({1.7e9 + t:.6f}) {bus} {i:03X}#{data.hex().upper()}" for t, bus, i, data in FRAMES)
    path.write_text("\n".join(lines) + "\n")
    return path


def read(path, chosen=""):
    buses = Buses(chosen)
    return [frame[1:] for frame in read_frames(path, buses=buses)], buses


def test_a_chosen_bus_is_read_alone(log):
    frames, buses = read(log, "can1")
    assert frames == [(0x100, b"\2"), (0x200, b"\3")]
    buses.check("two.log")


def test_an_id_on_two_buses_is_refused_with_their_names(log):
    _, buses = read(log)
    with pytest.raises(ImportFailed) as refused:
        buses.check("two.log")
    assert refused.value.reason.code == "log-two-buses"
    assert refused.value.reason.args["buses"] == ("can0", "can1")
    assert refused.value.reason.args["ids"] == "100"


def test_an_id_that_nobody_decodes_may_be_on_two_buses(log):
    _, buses = read(log)
    buses.check("two.log", {0x200})


def test_a_bus_that_is_not_in_the_log_is_named(log):
    frames, buses = read(log, "can7")
    assert frames == []
    with pytest.raises(ImportFailed) as refused:
        buses.check("two.log")
    assert refused.value.reason.code == "log-no-bus"


@pytest.mark.parametrize("ending", [".blf", ".asc", ".trc"])
def test_channels_of_other_loggers_are_buses(tmp_path, ending):
    path = tmp_path / f"two{ending}"
    with can.Logger(path) as logger:
        for t, bus, can_id, data in FRAMES:
            message = can.Message(
                timestamp=1.7e9 + t, arbitration_id=can_id, data=data, channel=int(bus[-1]) + 1, is_extended_id=False
            )
            logger(message)
    _, buses = read(path)
    with pytest.raises(ImportFailed) as refused:
        buses.check(path.name)
    _, first = refused.value.reason.args["buses"]
    frames, _ = read(path, first)
    assert frames == [(0x100, b"\2"), (0x200, b"\3")]
