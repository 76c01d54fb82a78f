"""What is inferred of batteries whose truth is known, for each way to address cells."""

from functools import cache

import numpy as np
import pytest

from app.battery.profile import read_document, understand
from app.sources.dbc.battery_decoder import BatteryDecoder
from app.sources.dbc.check import issues_of
from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.frames import frames_of
from app.sources.dbc.infer.bus_survey import survey_bus
from app.sources.dbc.infer.inference import infer_profile
from app.sources.dbc.infer.profile_text import profile_text
from tests.peer_batteries import PEERS, cell_number, half_a_round, one_signal_a_cell
from tests.peer_messages import HEAD, Bits, Sent, fixed, others
from tests.peer_messages import Peer as AnyPeer
from tests.wild_batteries import WILD, ranges_in_the_message

LONG_S = 16.0


def codes(inferred):
    return [question.code for question in inferred.questions]


def learned_of(peer, duration_s, choices=None):
    definitions = parse_definitions(peer.dbc().encode(), "x.dbc")
    frames = frames_of(peer.frames(duration_s) if duration_s else [])
    return definitions, frames, infer_profile(survey_bus(definitions, frames), frames, "x", ("x.dbc",), choices or {})


@cache
def learned_of_way(way):
    """A way to address cells with what its definitions, its frames and what is inferred of them; made once."""
    peer = PEERS[way]()
    return peer, *learned_of(peer, LONG_S)


def assert_learned_rightly(peer, duration_s=LONG_S):
    """Learn a battery; written as a profile and read again it decodes what is true."""
    return assert_decodes(peer, *learned_of(peer, duration_s))


def assert_decodes(peer, definitions, frames, inferred):
    _, found = assert_cells_decode(peer, definitions, frames, inferred)
    current = found["current"]
    expected = [peer.current(t / 1e9) for t in current.t_ns.tolist()]
    np.testing.assert_allclose(current.value, expected, atol=0.051)
    assert found["soc"].value[0] == pytest.approx(0.64)
    return inferred


def assert_cells_decode(peer, definitions, frames, inferred):
    """Read the profile of what was inferred again: it decodes cells, sensors and their sum; return both."""
    profile = understand(read_document(profile_text(inferred), "x.toml", lambda name: None))
    assert (profile.battery.n_cells, profile.battery.n_sensors) == (peer.n_cells, peer.n_sensors)
    assert peer.segments in (None, profile.battery.segments)
    found = BatteryDecoder(profile.battery, profile.source, definitions).decode(frames)
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
    return profile, found


@pytest.mark.parametrize("way", range(len(PEERS)), ids=[make().name for make in PEERS])
def test_what_is_learned_from_a_log_decodes_it(way):
    assert_decodes(*learned_of_way(way))


@pytest.mark.parametrize("way", range(len(PEERS)), ids=[make().name for make in PEERS])
def test_a_log_shows_nothing_against_what_is_learned_from_it(way):
    _, definitions, frames, inferred = learned_of_way(way)
    assert issues_of(inferred.battery, inferred.source, definitions, "x", frames) == []


@pytest.mark.parametrize("way", range(len(PEERS)), ids=[make().name for make in PEERS])
def test_without_a_log_names_alone_tell_the_signals(way):
    peer, _, _, with_log = learned_of_way(way)
    _, _, without = learned_of(peer, 0)
    assert without.source.cells["voltage"][0].signal == with_log.source.cells["voltage"][0].signal
    assert without.source.current.signal == with_log.source.current.signal
    if not with_log.source.cells["voltage"][0].numbers:
        assert without.battery.n_cells == peer.n_cells


@pytest.mark.parametrize("sizes", [(18,) * 6, (18, 18, 16, 20)])
def test_the_cells_of_a_sender_are_a_pack(sizes):
    """Cells numbered through, in messages of as many senders as there are packs: the DBC says whose they are."""
    peer = AnyPeer("senders", sum(sizes), 0, segments=sizes, resolution_v=0.001)
    senders = []
    for pack, size in enumerate(sizes):
        for k in range(0, size, 4):
            cells = range(sum(sizes[:pack]) + k, sum(sizes[:pack]) + min(k + 4, size))
            bits = [
                Bits(f"Cell_{i + 1}_Volt", 16 * j, 16, lambda t, i=i: peer.voltage(i, t), 0.001, unit="V")
                for j, i in enumerate(cells)
            ]
            peer.sent.append(Sent(0x200 + len(senders), f"Volts_{len(senders)}", 8, 0.1, [bits]))
            senders.append(f"Slave_{'ABCDEF'[pack]}")
    peer.sent += others(peer)
    text = peer.dbc()
    for k, sender in enumerate(senders):
        text = text.replace(f"Volts_{k}: 8 BMS", f"Volts_{k}: 8 {sender}")
    definitions, frames = parse_definitions(text.encode(), "x.dbc"), frames_of(peer.frames(6))
    inferred = infer_profile(survey_bus(definitions, frames), frames, "x", ("x.dbc",))
    assert_decodes(peer, definitions, frames, inferred)
    assert inferred.battery.segments == sizes


def test_of_two_temperatures_the_one_that_moves_is_taken():
    """Both are in range; a limit for each module has names like a temperature."""
    peer = AnyPeer("still", 24, 6, segments=(12, 12), resolution_v=0.001)
    cells = [
        Bits(f"Cell_{i + 1}_Volt", 16 * (i % 4), 16, lambda t, i=i: peer.voltage(i, t), 0.001, unit="V")
        for i in range(24)
    ]
    peer.sent += [Sent(0x100 + k, f"Volts_{k}", 8, 0.2, [cells[4 * k : 4 * k + 4]]) for k in range(6)]
    heats = [Bits(f"Temp_{k + 1}", 8 * k, 8, lambda t, k=k: peer.temperature(k, t), 1, -40, "degC") for k in range(6)]
    still = [Bits(f"Cell_Temp_{k + 1}", 8 * k, 8, fixed(40), 1, -40, "degC") for k in range(6)]
    peer.sent += [Sent(0x300, "Sensors", 6, 0.5, [heats]), Sent(0x301, "Modules", 6, 0.5, [still]), *others(peer)]
    _, _, inferred = learned_of(peer, 60)
    assert inferred.temperature.members[0][0].name == "Sensors"


def test_numbered_messages_of_packs_without_a_number_in_their_names_are_taken_in_order():
    peer = AnyPeer("names", 20, 0, segments=(5,) * 4, resolution_v=0.001)
    for pack, name in enumerate(("FrontLeft", "FrontRight", "RearLeft", "RearRight")):
        frames = [
            [
                Bits("Tap_No", 0, 8, fixed(tap)),
                Bits("Cell_Volt", 8, 16, lambda t, i=5 * pack + tap: peer.voltage(i, t), 0.001, unit="V"),
            ]
            for tap in range(5)
        ]
        peer.sent.append(Sent(0x120 + pack, f"{name}_CellVolt", 8, 0.2, frames))
    peer.sent += others(peer)
    assert_learned_rightly(peer, 6)


def test_cells_that_were_not_heard_yet_are_counted():
    peer = half_a_round()
    _, _, inferred = learned_of(peer, 14)
    assert inferred.battery.n_cells == 72
    assert inferred.source.cells["voltage"][0].checksum == "orion"


@pytest.mark.parametrize(("heard_s", "is_told"), [(3.0, True), (7.0, True), (9.0, False)])
def test_a_log_that_ends_before_the_first_round_of_cells_does_says_that_there_may_be_more(heard_s, is_told):
    _, _, inferred = learned_of(cell_number(), heard_s)  # a round takes 7.2 s
    assert ("infer-round-not-complete" in codes(inferred)) == is_told
    assert is_told or inferred.battery.n_cells == 72


def test_temperatures_in_tenths_of_a_kelvin_without_a_unit_are_a_guess_and_said_to_be_one():
    peer = one_signal_a_cell(8, 0, "Cell{}_V", "T{}", 0.0001, "V")
    heats = [Bits(f"Cell{k}_Temp", 16 * k, 16, lambda t, k=k: 10 * (peer.temperature(k, t) + 273.15)) for k in range(4)]
    peer.sent.insert(0, Sent(0x400, "Temps", 8, 0.2, [heats]))
    _, _, inferred = learned_of(peer, 3)
    guess = next(question for question in inferred.questions if question.code == "infer-temperature-unit-guessed")
    assert "0.1K" in (guess.args["unit"], *guess.args["others"].split(", "))
    assert "0.1K" in profile_text(inferred)


def test_temperatures_with_a_unit_are_no_guess():
    _, _, inferred = learned_of(one_signal_a_cell(8, 8, "V{}", "T{}", 0.0001, "V"), 3)
    assert "infer-temperature-unit-guessed" not in codes(inferred)


@pytest.mark.parametrize(
    ("name", "bits", "unit"), [("Cell{}_mV", 16, "mV"), ("Cell{}_Volt", 12, "mV"), ("Cell{}_Volt", 16, "0.1mV")]
)
def test_without_a_log_and_a_unit_the_guess_is_by_name_and_bits_and_said_to_be_one(name, bits, unit):
    lines = "".join(f' SG_ {name.format(k)} : {bits * k}|{bits}@1+ (1,0) [0|0] "" X\n' for k in range(4))
    definitions = parse_definitions((HEAD + "BO_ 1 Cells: 8 BMS\n" + lines).encode(), "x.dbc")
    inferred = infer_profile(survey_bus(definitions, frames_of([])), frames_of([]), "x", ("x.dbc",))
    assert inferred.source.cells["voltage"][0].unit == unit
    assert {"infer-unit-guessed", "infer-no-temperatures", "infer-no-current"} <= set(codes(inferred))


def test_a_bus_without_cells_suggests_nothing():
    peer = AnyPeer("none", 4, 0)
    peer.sent = [each for each in others(peer) if "Cell" not in each.name]
    assert learned_of(peer, 5)[2] is None


def test_a_wrong_unit_in_the_dbc_is_corrected_by_what_is_heard():
    dbc = (
        HEAD + "BO_ 1 Cells: 8 BMS\n" + "".join(f' SG_ Cell{k} : {16 * k}|16@1+ (1,0) [0|0] "V" X\n' for k in range(4))
    )
    frames = frames_of([(t, 1, b"".join((3700 + k).to_bytes(2, "little") for k in range(4))) for t in range(9)])
    definitions = parse_definitions(dbc.encode(), "x.dbc")
    inferred = infer_profile(survey_bus(definitions, frames), frames, "x", ("x.dbc",))
    assert inferred.source.cells["voltage"][0].unit == "mV"


@pytest.mark.parametrize("make", WILD, ids=[make.__name__ for make in WILD])
def test_batteries_as_teams_describe_them_are_learned_from_a_log_and_their_cells_from_the_dbc_alone(make):
    peer = make()
    _, found = assert_cells_decode(peer, *learned_of(peer, LONG_S))
    assert np.ptp(found["current"].value) > 100
    alone = learned_of(peer, 0)[2].battery
    assert (alone.n_cells, alone.n_sensors) == (peer.n_cells, peer.n_sensors)


def test_a_counter_and_a_crc_in_each_frame_are_no_temperatures():
    assert "temperature" not in learned_of(ranges_in_the_message(), LONG_S)[2].source.cells
