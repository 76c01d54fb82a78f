"""A quantity that is missing is missing; what it last was stays next to it, with its time, and is counted nowhere."""

import json

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.live.history import History
from app.telemetry.encoding import encode, plain
from app.telemetry.measurement import BLANK_S

CELL = load_cell("samsung-25r-10p")
V = 37_000  # counts of every cell
WALL_NS = 1_700_000_000_000_000_000
LOST = range(36, 48)
STILL = list(range(36)) + list(range(48, 96))


@pytest.fixture
def pipeline(make_pipeline, master):
    chain = make_pipeline()
    master.set("v", [V + i for i in range(96)])
    master.set("v_tot", [round((V * 96 + 48 * 95) / 100)])
    master.set("t", [25 + i % 8 for i in range(96)])
    return chain


def drive(pipeline, master, n=5):
    for _ in range(n):
        output = pipeline.feed(master.frame())
        pipeline.predict()
    return output.snapshot


def silent(pipeline, master, seconds):
    t_ns = master.t_ns + round(seconds * 1e9)
    return pipeline.tick(t_ns, WALL_NS + t_ns)


def lose(master):
    master.set("v", [0xFFFF if cell in LOST else V + cell for cell in range(96)])
    master.set("t", [-128 if cell in LOST else 25 for cell in range(96)])
    master.set("v_tot", [round(sum(V + cell for cell in STILL) / 100)])


def wall_s(master):
    return (WALL_NS + master.t_ns) / 1e9


def sent(snapshot):
    return json.loads(encode(plain(snapshot, snapshot.segments)))


def test_what_is_live_has_no_last_value(pipeline, master):
    assert pipeline.tick(master.t_ns, WALL_NS).snapshot.last_known is None  # nothing was ever measured
    assert sent(drive(pipeline, master))["last_known"] is None
    assert silent(pipeline, master, BLANK_S - 0.5).snapshot.last_known is None  # old, and still in its own place


def test_a_silent_car_keeps_its_last_values_with_their_time_and_they_are_in_no_array(pipeline, master):
    live = drive(pipeline, master)
    blank = sent(silent(pipeline, master, 180).snapshot)
    for name in ("voltage_v", "temperature_degc", "soc"):
        assert blank["cells"][name] == [None] * 96
        last = blank["last_known"]["cells"][name]
        assert last["values"] == pytest.approx(getattr(live.cells, name).tolist(), abs=1e-5)
        assert last["time"] == pytest.approx(wall_s(master), abs=0.1)
        assert "times" not in last
    total, last = blank["accumulator"], blank["last_known"]["accumulator"]
    for name in ("voltage_v", "current_a", "power_w", "soc", "driver_soc_percent", "voltage_min_v", "voltage_delta_v"):
        assert total[name] is None
        assert last[name]["value"] == pytest.approx(getattr(live.accumulator, name), abs=1e-5)
        assert last[name]["time"] == pytest.approx(wall_s(master), abs=0.1)
    assert (last["voltage_max_v"]["cell"], last["voltage_min_v"]["cell"]) == (95, 0)
    assert total["loaded_cells"] == 0
    pack = blank["last_known"]["packs"][3]
    assert pack["voltage_v"]["value"] == pytest.approx(live.packs[3].voltage_v, abs=1e-5)
    assert pack["temperature_max_degc"]["value"] == live.packs[3].temperature_max_degc


def test_the_last_soc_is_the_filters_not_the_masters_of_the_same_moment(pipeline, master):
    live = drive(pipeline, master)
    for tenths in range(95, 130):
        blank = silent(pipeline, master, tenths / 10).snapshot
    assert live.accumulator.soc_source == "filter"
    assert blank.last_known.accumulator.soc.value == live.accumulator.soc


def test_a_lost_slave_keeps_its_cells_last_values_and_the_others_stay_live(pipeline, master):
    whole = drive(pipeline, master)
    at_s = wall_s(master)
    lose(master)
    for _ in range(50):
        half = sent(pipeline.feed(master.frame()).snapshot)
    last = half["last_known"]["cells"]["voltage_v"]
    assert half["cells"]["voltage_v"][36:48] == [None] * 12
    assert last["values"][36:48] == pytest.approx(whole.cells.voltage_v[36:48].tolist())
    assert [last["values"][i] for i in STILL] == [None] * 84
    assert last["time"] == pytest.approx(at_s, abs=0.1)
    assert half["accumulator"]["voltage_v"] is None
    known = half["last_known"]["accumulator"]
    assert known["voltage_v"]["value"] == pytest.approx(whole.accumulator.voltage_v)  # when it was whole
    assert known["voltage_v"]["time"] == pytest.approx(at_s, abs=0.1)
    assert "voltage_min_v" not in known  # the measured cells have their own
    assert [i for i, pack in enumerate(half["last_known"]["packs"]) if pack] == [3]


def test_each_cell_has_its_own_time_where_they_went_at_different_times(pipeline, master):
    drive(pipeline, master)
    lost_s = wall_s(master)
    lose(master)
    drive(pipeline, master, 300)
    last = sent(silent(pipeline, master, 60).snapshot)["last_known"]["cells"]["voltage_v"]
    assert last["time"] == pytest.approx(lost_s, abs=0.1)
    assert [last["times"][i] for i in LOST] == pytest.approx([lost_s] * 12, abs=0.1)
    assert [last["times"][i] for i in STILL] == pytest.approx([wall_s(master)] * 84, abs=0.1)


def test_new_values_end_it_and_a_new_run_knows_nothing(pipeline, make_pipeline, master):
    drive(pipeline, master)
    assert silent(pipeline, master, 60).snapshot.last_known is not None
    master.advance(61_000)
    assert pipeline.feed(master.frame()).snapshot.last_known is None
    assert silent(make_pipeline(), master, 60).snapshot.last_known is None


def test_the_age_of_a_last_value_is_right_though_the_wall_clock_was_set(pipeline, master):
    drive(pipeline, master)
    t_ns, hour_ns = master.t_ns + 60 * 10**9, 3600 * 10**9
    snapshot = pipeline.tick(t_ns, WALL_NS + t_ns + hour_ns).snapshot
    assert snapshot.t_wall_ns / 1e9 - snapshot.last_known.cells.voltage_v.time == pytest.approx(60, abs=0.1)


def test_a_silent_car_with_last_values_beyond_a_limit_alarms_nothing_and_steps_no_filter(pipeline, master):
    drive(pipeline, master)
    master.set("v", [45_000 if cell in LOST else V for cell in range(96)])  # beyond every limit
    drive(pipeline, master)
    before = pipeline.estimates
    output = silent(pipeline, master, 60)
    assert output.snapshot.last_known.cells.voltage_v.values[36] == pytest.approx(4.5)
    assert (output.estimates, output.events) == (None, ())
    assert pipeline.estimates is before
    assert [pack.voltage_v for pack in output.snapshot.packs] == [None] * 8


def test_history_keeps_no_row_of_a_last_value(pipeline, master):
    history = History(96)
    history.add(drive(pipeline, master))
    lose(master)
    master.set("v", [45_000 if cell == 48 else 0xFFFF if cell in LOST else V for cell in range(96)])
    half = drive(pipeline, master)
    assert half.last_known.cells.voltage_v.values[36] == pytest.approx(3.7036)
    history.add(half)
    history.add(silent(pipeline, master, 60).snapshot)
    lost = history.read(60, 36)["series"]["voltage_v"]
    assert [None if np.isnan(v) else round(float(v), 4) for v in lost] == [3.7036, None]
