"""A stream of the thesis's master, with a byte in a hundred damaged for an hour: no value of another place."""

import numpy as np
import pytest

from app.sources.loaded_battery import load_battery
from app.sources.serial.decoder import SerialDecoder
from app.sources.serial.framing import StreamReader
from tests.campaign import campaign, of_size, report_figure
from tests.thesis_streams import DEGC, STREAMS, current_a, volts

SECONDS = of_size(600, 3600, 3600, 4 * 3600)
WORST_V, WORST_DEGC, WORST_A = 0.08, 8.0, 200.0  # steps that are allowed, from values that a low byte had moved


def replayed(name, seconds, *, damaged, seed=1):
    """Yield the sample's number, the values read of it by kind, and its frames, of a line replayed fast."""
    random = np.random.default_rng(seed)
    battery = load_battery(name)
    reader, decoder = StreamReader(battery.serial), SerialDecoder(battery.battery, battery.serial)
    t_ns = 0
    for k in range(seconds):
        sent = np.frombuffer(STREAMS[name](k), np.uint8).copy()
        if damaged:
            hit = random.random(len(sent)) < 0.01
            sent[hit] = random.integers(0, 256, hit.sum())
            if random.random() < 0.1:
                sent = np.delete(sent, random.integers(len(sent)))
        t_ns += 1_000_000_000
        found = reader.feed(sent.tobytes(), t_ns)
        found += reader.idle(t_ns + 500_000_000)
        yield k, decoder.decode(found), found


@pytest.mark.parametrize("name", STREAMS)
def test_an_undamaged_stream_shows_all_cells_and_no_wrong_value(name):
    for k, values, found in replayed(name, 60, damaged=False):
        assert len(found) == 1
        if k == 0:
            continue  # the first waits for a second that is like it
        assert values["voltage"].index[-96:].tolist() == list(range(96))
        assert values["voltage"].value[-96:] == pytest.approx(volts(k))
        assert values["temperature"].value[-96:].tolist() == DEGC
        assert values["current"].value.tolist() == [pytest.approx(current_a(k))]


@pytest.mark.parametrize("name", STREAMS)
@campaign(60, 120, 600)
def test_damage_gives_no_frame_at_a_wrong_place_and_implausible_steps_are_left_out(name):
    worst = dict.fromkeys(("voltage", "temperature", "current"), 0.0)
    n_read, n_off = 0, 0
    for k, values, _ in replayed(name, SECONDS, damaged=True):
        true = {"voltage": volts(k), "temperature": np.array(DEGC, float), "current": np.array([current_a(k)])}
        for kind, of_kind in values.items():
            if kind in worst:
                off = np.abs(of_kind.value - true[kind][of_kind.index])
                worst[kind] = max(worst[kind], float(off.max()))
        if "voltage" in values:
            n_read += len(values["voltage"].value)
            n_off += int((np.abs(values["voltage"].value - volts(k)[values["voltage"].index]) > 0.001).sum())
    assert worst["voltage"] < WORST_V
    assert worst["temperature"] <= WORST_DEGC
    assert worst["current"] <= WORST_A
    least = 0.7 if name == "thesis-hex" else 0.8  # a lost character, or a line's end among them, costs the line
    assert n_read > least * SECONDS * 96
    assert n_off < 0.02 * n_read  # a frame at a wrong place would be off in all
    report_figure(
        f"{name}: {SECONDS} s, {n_read / SECONDS / 96:.0%} of the voltages read, worst {worst['voltage']:.3f} V"
    )
