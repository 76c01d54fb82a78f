"""The pipeline of batteries of other shapes: 14 to 600 cells, segments that differ, sensors that stand for several."""

from dataclasses import replace

import numpy as np
import pytest

from app.battery.battery import Battery, SignalName, spread
from app.battery.source import CellSignals, DbcMapping, ScalarSignal, StateSignal
from app.live.history import History
from app.live.learned_state import LearnedState, learned_file, load_learned_state, save_learned_state
from app.live.pipeline_factory import PipelineFactory
from app.live.trend import Trend
from app.sources.dbc.dbc_file import parse_definitions
from app.sources.items import CanItem
from app.sources.loaded_battery import LoadedBattery
from app.words import Pack
from tests.peer_messages import HEAD

S = 1_000_000_000
SHAPES = {14: (14,), 96: (12,) * 8, 140: (28,) * 5, 216: (18,) * 12, 600: (50,) * 12, 29: (9, 12, 8)}


def loaded(segments, n_sensors=0, **limits):
    """Two voltages of 16 bits a frame, a temperature of 8 bits each."""
    n = sum(segments)
    battery = Battery("made", segments, 10, sensors=spread(n_sensors, range(n)), limits=limits)
    entries = {"voltage": (CellSignals("V{cell}"),)}
    text = HEAD
    for at in range(0, n, 4):
        text += f"BO_ {256 + at} C{at}: 8 BMS\n"
        text += "".join(f' SG_ V{at + k} : {16 * k}|16@1+ (0.001,0) [0|0] "V" X\n' for k in range(min(4, n - at)))
    if n_sensors:
        entries["temperature"] = (CellSignals("T{cell}"),)
        for at in range(0, n_sensors, 8):
            text += f"BO_ {1200 + at} H{at}: 8 BMS\n"
            last = min(8, n_sensors - at)
            text += "".join(f' SG_ T{at + k} : {8 * k}|8@1- (1,0) [0|0] "degC" X\n' for k in range(last))
    text += 'BO_ 1 I: 4 BMS\n SG_ I : 0|16@1- (0.1,0) [0|0] "A" X\n SG_ U : 16|16@1+ (0.1,0) [0|0] "V" X\n'
    source = DbcMapping(("x.dbc",), entries, ScalarSignal(SignalName("I", "I")), ScalarSignal(SignalName("I", "U")))
    return LoadedBattery(battery, source, parse_definitions(text.encode(), "x.dbc"), {})


def drive(pipeline, seconds, volts, current_a=0.0, degc=None, from_s=0):
    """Feed periods of 0.1 s; return the snapshots."""
    found = []
    counts = np.round(np.asarray(volts) * 1000).astype("<u2")
    total = np.array([round(current_a * 10), round(float(counts.sum()) / 100) & 0x7FFF], "<i2").tobytes()
    for k in range(round(seconds * 10)):
        t_ns = from_s * S + k * S // 10
        frames = [(256 + at, counts[at : at + 4].tobytes().ljust(8, b"\0")) for at in range(0, len(counts), 4)]
        if degc is not None:
            heats = np.asarray(degc).astype(np.int8)
            frames += [(1200 + at, heats[at : at + 8].tobytes().ljust(8, b"\0")) for at in range(0, len(heats), 8)]
        for can_id, data in [*frames, (1, total)]:
            snapshot = pipeline.feed(CanItem(t_ns, S + t_ns, can_id, data)).snapshot
            if snapshot is not None:
                found.append(snapshot)
                pipeline.predict()
    return found


@pytest.mark.parametrize("segments", SHAPES.values(), ids=map(str, SHAPES))
def test_every_cell_is_estimated_judged_and_kept_whatever_the_shape(segments, tmp_path):
    n = sum(segments)
    battery = loaded(segments, max(1, n // 3))
    pipeline = PipelineFactory("coulomb", None, battery).pipeline("can")
    volts = 3.7 + 0.001 * (np.arange(n) % 7)
    history, trend = History(n), Trend(n)
    for snapshot in drive(pipeline, 3, volts, degc=np.full(max(1, n // 3), 25)):
        history.add(snapshot)
        trend.add(snapshot)
    assert snapshot.segments == segments
    assert np.isfinite(snapshot.cells.soc).all()
    np.testing.assert_allclose(snapshot.cells.voltage_v, volts)
    np.testing.assert_allclose(snapshot.cells.temperature_degc, 25)
    sums = np.add.reduceat(volts, battery.battery.starts)
    assert [pack.voltage_v for pack in snapshot.packs] == pytest.approx(list(sums))
    assert snapshot.prediction.power is not None
    assert snapshot.alarms == ()
    assert len(history.read(900, n - 1)["time"]) > 5
    assert trend.read(n - 1)["balanced_s"] == 0
    path = tmp_path / learned_file("made", is_team=False)
    predictor = PipelineFactory("coulomb", None, battery).predictor()
    state = LearnedState(pipeline.charge, predictor.learned_cells)
    save_learned_state(path, state)
    assert load_learned_state(path, n).charge.soc.shape == (n,)
    assert load_learned_state(path, n + 1) is None


def codes(snapshots):
    return {alarm.code for alarm in snapshots[-1].alarms if alarm.active}


def test_a_battery_without_temperatures_is_estimated_and_says_nothing_of_them():
    found = drive(PipelineFactory("fused", None, loaded((9, 12, 8))).pipeline("can"), 3, np.full(29, 3.7), 10.0)
    assert np.isfinite(found[-1].cells.soc).all()
    assert found[-1].accumulator.temperature_max_degc is None
    assert codes(found) == set()


@pytest.mark.parametrize(
    ("limit", "value", "code"),
    [
        ("cell_voltage_max_v", 3.65, "cell-overvoltage"),
        ("cell_voltage_min_v", 3.75, "cell-undervoltage"),
        ("discharge_current_max_a", 8.0, "discharge-overcurrent"),
        ("pack_voltage_max_v", 100.0, "accumulator-voltage-high"),
        ("segment_voltage_max_v", 40.0, "pack-voltage-high"),
        ("temperature_max_degc", 20.0, "cell-overtemperature"),
    ],
)
def test_each_limit_of_a_profile_alone_raises_its_alarm_without_a_signal_for_the_state(limit, value, code):
    battery = loaded((9, 12, 8), 29, **{limit: value})
    found = drive(PipelineFactory("coulomb", None, battery).pipeline("can"), 2, np.full(29, 3.7), 10.0, np.full(29, 25))
    assert codes(found) == {code}
    assert found[-1].master.state == "unknown"


def test_the_pack_above_its_limit_is_named():
    battery = loaded((9, 12, 8), segment_voltage_max_v=40.0)
    found = drive(PipelineFactory("coulomb", None, battery).pipeline("can"), 2, np.full(29, 3.7))
    (alarm,) = found[-1].alarms
    assert alarm.message.args["pack"] == Pack(1)
    assert alarm.value == pytest.approx(44.4)


def test_a_sensor_that_stands_for_several_cells_is_found_once():
    battery = loaded((12,), 6)
    pipeline = PipelineFactory("coulomb", None, battery).pipeline("can")
    drive(pipeline, 20, np.full(12, 3.7), degc=[25, 25, 25, 25, 25, 25])
    found = drive(pipeline, 20, np.full(12, 3.7), degc=[25, 25, 45, 25, 25, 25], from_s=20)
    assert [(each.code, each.cell) for each in found[-1].findings] == [("temperature-sensor-fault", 4)]


def test_a_fault_that_the_bms_tells_is_its_own_alarm_and_no_word_of_a_circuit():
    battery = loaded((12,))
    told = replace(battery.source, states={"fault": StateSignal(SignalName("I", "U"), mask=0xFFFF)})
    pipeline = PipelineFactory("coulomb", None, replace(battery, source=told)).pipeline("can")
    assert codes(drive(pipeline, 2, np.full(12, 3.7))) == {"bms-fault"}


def test_cells_that_were_not_heard_yet_are_no_alarm_until_the_first_round_is_over():
    battery = loaded((9, 12, 8))
    pipeline = PipelineFactory("coulomb", None, battery).pipeline("can")
    assert codes(drive(pipeline, 2.5, np.full(12, 3.7))) == set()  # 17 cells are still to come
    found = drive(pipeline, 4, np.full(12, 3.7), from_s=3)
    assert codes(found) == {"cell-voltage-missing", "slave-lost"}
    by_code = {alarm.code: alarm for alarm in found[-1].alarms}
    assert by_code["cell-voltage-missing"].cells == tuple(range(12, 21))
    assert by_code["slave-lost"].message.args["packs"] == (Pack(2),)  # none of its eight cells has a voltage
