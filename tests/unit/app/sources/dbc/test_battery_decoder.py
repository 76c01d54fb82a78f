import numpy as np
import pytest

from app.battery.profile import read_document, understand
from app.sources.dbc.assembly import Assembler
from app.sources.dbc.battery_decoder import BatteryDecoder
from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.frames import frames_of
from tests.peer_batteries import HEAD, PEERS, cell_number, one_signal_a_cell

CURRENT = """
[source.current]
signal = "BMS_PackStatus.Pack_Current"
positive = "discharge"
[source.pack_voltage]
signal = "BMS_PackStatus.Pack_Voltage"
[source.soc]
signal = "BMS_PackStatus.Pack_SOC"
"""


def battery_and_source(text, n_cells, n_sensors, segments=None, more=""):
    head = f'[battery]\nname = "x"\nsegments = {list(segments or (n_cells,))}\n'
    head += f"[battery.temperatures]\nsensors = {n_sensors}\n"
    profile = understand(read_document(f'{head}[source]\ndbc = "x.dbc"\n{text}{more}', "x.toml", lambda name: None))
    return profile.battery, profile.source


def decoder_of(peer, more=""):
    battery, source = battery_and_source(peer.profile, peer.n_cells, peer.n_sensors, peer.segments, more)
    return BatteryDecoder(battery, source, parse_definitions(peer.dbc().encode(), "x.dbc"))


@pytest.mark.parametrize("make", PEERS, ids=[make().name for make in PEERS])
def test_every_way_to_address_cells_gives_every_cell_its_own_voltage(make):
    peer = make()
    decoder = decoder_of(peer)
    assert decoder.lanes.troubles == ()
    found = decoder.decode(frames_of(peer.frames(8)))
    voltages = found["voltage"]
    assert set(voltages.index.tolist()) == set(range(peer.n_cells))
    expected = [peer.voltage(c, t / 1e9) for c, t in zip(voltages.index.tolist(), voltages.t_ns.tolist(), strict=True)]
    np.testing.assert_allclose(voltages.value, expected, atol=0.51 * peer.resolution_v + 1e-9)
    assert list(voltages.t_ns) == sorted(voltages.t_ns)
    if peer.n_sensors:
        heat = found["temperature"]
        assert set(heat.index.tolist()) == set(range(peer.n_sensors))
        expected = [peer.temperature(s, t / 1e9) for s, t in zip(heat.index.tolist(), heat.t_ns.tolist(), strict=True)]
        np.testing.assert_allclose(heat.value, expected, atol=0.51)


@pytest.mark.parametrize("make", PEERS, ids=[make().name for make in PEERS])
def test_batches_of_any_size_give_what_one_gives(make):
    peer = make()
    frames = frames_of(peer.frames(2))
    whole = decoder_of(peer).decode(frames)["voltage"]
    decoder = decoder_of(peer)
    parts = [decoder.decode(frames.part(slice(i, i + 37))).get("voltage") for i in range(0, len(frames), 37)]
    np.testing.assert_array_equal(np.concatenate([part.value for part in parts if part]), whole.value)
    np.testing.assert_array_equal(np.concatenate([part.index for part in parts if part]), whole.index)


def test_a_frame_with_a_wrong_checksum_tells_nothing():
    peer = cell_number()
    decoder = decoder_of(peer)
    broken = [(t, i, data[:7] + bytes([data[7] ^ 1])) for t, i, data in peer.frames(8) if i == 0x036]
    assert "voltage" not in decoder.decode(frames_of(broken))
    assert decoder.bad_checksums == len(broken)


def test_invalid_numbers_and_flags_are_missing_and_not_zero():
    dbc = HEAD + 'BO_ 1 M: 8 BMS\n SG_ V1 : 0|16@1+ (0.001,0) [0|0] "V" X\n SG_ Bad1 : 16|1@1+ (1,0) [0|1] "" X\n'
    text = '[[source.voltage]]\nsignal = "V{cell}"\nbase = 1\ninvalid = [0, 65535]\ninvalid_signal = "Bad{cell}"\n'
    text += "valid_range = [0.5, 5.0]\n"
    battery, source = battery_and_source(text, 1, 0)
    decoder = BatteryDecoder(battery, source, parse_definitions(dbc.encode(), "x.dbc"))
    raw = [(3700, 0), (0, 0), (65535, 0), (3700, 1), (9000, 0)]
    frames = frames_of([(t, 1, v.to_bytes(2, "little") + bytes([bad])) for t, (v, bad) in enumerate(raw)])
    np.testing.assert_array_equal(decoder.decode(frames)["voltage"].value, [3.7] + [np.nan] * 4)


def test_a_number_that_no_cell_has_is_counted_and_told():
    peer = cell_number()
    battery, source = battery_and_source(peer.profile, 70, 12)
    decoder = BatteryDecoder(battery, source, parse_definitions(peer.dbc().encode(), "x.dbc"))
    found = decoder.decode(frames_of(peer.frames(7.2)))["voltage"]
    assert found.index.max() == 69
    assert decoder.beyond["CellBroadcast.Cell_Voltage"] == 2


def test_a_measurement_holds_the_newest_of_each_with_its_own_time():
    peer = one_signal_a_cell(8, 8, "V{}", "T{}", 0.0001, "V")
    decoder = decoder_of(peer, CURRENT)
    assembler = Assembler(decoder.battery, decoder.source)
    frames = frames_of(peer.frames(3))
    found = [
        m for i in range(0, len(frames), 11) for m in assembler.feed(decoder.decode(frames.part(slice(i, i + 11))))
    ]
    assert [m.t_ns for m in found] == [found[0].t_ns + 100_000_000 * i for i in range(len(found))]
    last = found[-1]
    assert np.all(last.voltage_t_ns <= last.t_ns)
    np.testing.assert_allclose(
        last.voltage_v, [peer.voltage(c, t / 1e9) for c, t in enumerate(last.voltage_t_ns)], atol=1e-4
    )
    assert last.current_a == pytest.approx(peer.current(last.current_t_ns / 1e9), abs=0.06)
    assert last.soc == pytest.approx(0.64)
    assert last.pack_voltage_v == pytest.approx(peer.pack_voltage(last.t_ns / 1e9), abs=3)
    whole = Assembler(decoder.battery, decoder.source).feed(decoder.decode(frames))
    np.testing.assert_array_equal(whole[-1].voltage_v, last.voltage_v)
    assert [m.is_sample for m in whole] == [m.is_sample for m in found]


def test_what_is_not_heard_any_more_becomes_missing_and_never_stays_live():
    peer = one_signal_a_cell(8, 0, "V{}", "T{}", 0.0001, "V")
    peer.profile = '[[source.voltage]]\nsignal = "V{cell}"\nbase = 1\n'
    decoder = decoder_of(peer, CURRENT)
    assembler = Assembler(decoder.battery, decoder.source)
    frames = frames_of(peer.frames(3))
    found = assembler.feed(decoder.decode(frames))
    assert np.isfinite(found[-1].voltage_v).all()
    later = assembler.feed({}, int(frames.t_ns[-1]) + 5_000_000_000)
    assert np.isnan(later[-1].voltage_v).all()
    assert np.isnan(later[-1].current_a)
    assert not later[-1].is_sample


def test_after_a_pause_of_the_bus_old_values_are_not_live_for_long():
    peer = one_signal_a_cell(8, 0, "V{}", "T{}", 0.0001, "V")
    peer.profile = '[[source.voltage]]\nsignal = "V{cell}"\nbase = 1\n'
    decoder = decoder_of(peer, CURRENT)
    assembler = Assembler(decoder.battery, decoder.source)
    first = peer.frames(3)
    again = [(t + 63_000_000_000, can_id, data) for t, can_id, data in peer.frames(1)]
    for part in (first, again):
        assembler.feed(decoder.decode(frames_of(part)))
    later = assembler.feed({}, again[-1][0] + 5_000_000_000)
    assert np.isnan(later[-1].voltage_v).all()
    assert np.isnan(later[-1].current_a)
