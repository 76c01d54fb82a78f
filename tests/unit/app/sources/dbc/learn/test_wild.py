"""What is learned of batteries as teams' own DBCs describe them, and of simulated ones from their logs."""

import numpy as np
import pytest

from app.battery.profile import read_document, understand
from app.sources.dbc.battery_decoder import BatteryDecoder
from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.frames import frames_of
from app.sources.dbc.learn.learning import learn
from app.sources.dbc.learn.profile_text import profile_text
from app.sources.dbc.learn.survey import survey
from tests.wild_batteries import WILD, ranges_in_the_message


def learned_of(peer, duration_s=16.0):
    definitions = parse_definitions(peer.dbc().encode(), "x.dbc")
    frames = frames_of(peer.frames(duration_s) if duration_s else [])
    learned = learn(survey(definitions, frames), frames, "x", ("x.dbc",))
    profile = understand(read_document(profile_text(learned), "x.toml", lambda name: None))
    return profile, BatteryDecoder(profile.battery, profile.source, definitions).decode(frames)


@pytest.mark.parametrize("make", WILD, ids=[make.__name__ for make in WILD])
def test_a_log_and_its_dbc_are_learned_rightly(make):
    peer = make()
    profile, found = learned_of(peer)
    battery = profile.battery
    assert (battery.n_cells, battery.n_sensors) == (peer.n_cells, peer.n_sensors)
    assert peer.segments in (None, battery.segments)
    for kind, true, atol in (
        ("voltage", peer.voltage, 0.51 * peer.resolution_v),
        ("temperature", peer.temperature, 0.51),
    ):
        if kind in found:
            values = found[kind]
            expected = [true(i, t / 1e9) for i, t in zip(values.index.tolist(), values.t_ns.tolist(), strict=True)]
            np.testing.assert_allclose(values.value, expected, atol=atol + 1e-9)
    assert set(found["voltage"].index.tolist()) == set(range(peer.n_cells))
    pack = found["pack_voltage"]
    np.testing.assert_allclose(pack.value, [peer.pack_voltage(t / 1e9) for t in pack.t_ns.tolist()], atol=0.051)
    assert np.ptp(found["current"].value) > 100


@pytest.mark.parametrize("make", WILD, ids=[make.__name__ for make in WILD])
def test_the_dbc_alone_tells_the_cells(make):
    peer = make()
    profile, _ = learned_of(peer, 0)
    assert (profile.battery.n_cells, profile.battery.n_sensors) == (peer.n_cells, peer.n_sensors)


def test_a_counter_and_a_crc_in_each_frame_are_no_temperatures():
    profile, _ = learned_of(ranges_in_the_message())
    assert "temperature" not in profile.source.cells
