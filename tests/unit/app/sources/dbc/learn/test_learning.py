"""What is learned of batteries whose truth is known, for each way to address cells."""

import numpy as np
import pytest

from app.battery.profile import read_document, understand
from app.sources.dbc.battery_decoder import BatteryDecoder
from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.frames import frames_of
from app.sources.dbc.learn.learning import learn
from app.sources.dbc.learn.profile_text import profile_text
from app.sources.dbc.learn.survey import survey
from tests.peer_batteries import HEAD, PEERS, half_a_round, others
from tests.peer_batteries import Peer as AnyPeer

LONG_S = 16.0


def learned_of(peer, duration_s):
    definitions = parse_definitions(peer.dbc().encode(), "x.dbc")
    frames = frames_of(peer.frames(duration_s) if duration_s else [])
    return definitions, frames, learn(survey(definitions, frames), frames, "x", ("x.dbc",))


@pytest.mark.parametrize("make", PEERS, ids=[make().name for make in PEERS])
def test_what_is_learned_from_a_log_decodes_it(make):
    peer = make()
    definitions, frames, learned = learned_of(peer, LONG_S)
    text = profile_text(learned)
    profile = understand(read_document(text, "x.toml", lambda name: None))
    battery = profile.battery
    assert (battery.n_cells, battery.n_sensors) == (peer.n_cells, peer.n_sensors)
    assert peer.segments in (None, battery.segments)
    decoder = BatteryDecoder(battery, profile.source, definitions)
    found = decoder.decode(frames)
    voltages = found["voltage"]
    expected = [peer.voltage(c, t / 1e9) for c, t in zip(voltages.index.tolist(), voltages.t_ns.tolist(), strict=True)]
    np.testing.assert_allclose(voltages.value, expected, atol=0.51 * peer.resolution_v + 1e-9)
    assert set(voltages.index.tolist()) == set(range(peer.n_cells))
    current = found["current"]
    expected = [peer.current(t / 1e9) for t in current.t_ns.tolist()]
    np.testing.assert_allclose(current.value, expected, atol=0.051)
    pack = found["pack_voltage"]
    np.testing.assert_allclose(pack.value, [peer.pack_voltage(t / 1e9) for t in pack.t_ns.tolist()], atol=0.051)
    assert found["soc"].value[0] == pytest.approx(0.64)


@pytest.mark.parametrize("make", PEERS, ids=[make().name for make in PEERS])
def test_without_a_log_names_alone_tell_the_signals(make):
    peer = make()
    _, _, with_log = learned_of(peer, LONG_S)
    _, _, without = learned_of(peer, 0)
    assert without.source.cells["voltage"][0].signal == with_log.source.cells["voltage"][0].signal
    assert without.source.current.signal == with_log.source.current.signal
    if not with_log.source.cells["voltage"][0].numbers:
        assert without.battery.n_cells == peer.n_cells


def test_cells_that_were_not_heard_yet_are_counted():
    peer = half_a_round()
    _, _, learned = learned_of(peer, 14)
    assert learned.battery.n_cells == 72
    assert learned.source.cells["voltage"][0].checksum == "orion"


def test_a_bus_without_cells_suggests_nothing():
    peer = AnyPeer("none", 4, 0)
    peer.sent = [each for each in others(peer) if "Cell" not in each.name]
    assert learned_of(peer, 5)[2] is None


def test_every_text_of_a_suggestion_is_a_sound_profile_with_reasons():
    text = profile_text(learned_of(PEERS[0](), LONG_S)[2])
    assert "# " in text
    assert understand(read_document(text, "x.toml", lambda name: None)).battery.n_cells == 90


def test_a_wrong_unit_in_the_dbc_is_corrected_by_what_is_heard():
    dbc = (
        HEAD + "BO_ 1 Cells: 8 BMS\n" + "".join(f' SG_ Cell{k} : {16 * k}|16@1+ (1,0) [0|0] "V" X\n' for k in range(4))
    )
    frames = frames_of([(t, 1, b"".join((3700 + k).to_bytes(2, "little") for k in range(4))) for t in range(9)])
    definitions = parse_definitions(dbc.encode(), "x.dbc")
    learned = learn(survey(definitions, frames), frames, "x", ("x.dbc",))
    assert learned.source.cells["voltage"][0].unit == "mV"
