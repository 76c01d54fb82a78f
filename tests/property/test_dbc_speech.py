"""What a simulated battery says, against cantools' own decoding and the live decoder: every way to address cells."""

from functools import cache
from pathlib import Path

import cantools
import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from app.battery.library import load_part, load_profile
from app.battery.profile import read_document, understand
from app.battery.source import DbcMapping
from app.sources.dbc.assembly import Assembler
from app.sources.dbc.battery_decoder import BatteryDecoder
from app.sources.dbc.dbc_file import load_definitions, parse_definitions
from app.sources.dbc.definitions import Definitions
from app.sources.dbc.encoder import FrameEncoder
from app.sources.dbc.frames import frames_of
from tests.campaign import of_size
from tests.peer_batteries import PEERS

SCALARS = ("current", "pack_voltage", "soc", "charger_voltage", "charger_current")
SETTINGS = settings(
    max_examples=of_size(2, 6, 30), deadline=None, phases=[Phase.generate], suppress_health_check=list(HealthCheck)
)


@cache
def of_peer(make):
    peer = make()
    text = (
        f'[battery]\nname = "peer"\nsegments = {list(peer.segments or (peer.n_cells,))}\n'
        f'[battery.temperatures]\nsensors = {peer.n_sensors}\n[source]\ndbc = "peer.dbc"\n{peer.profile}'
    )
    profile = understand(read_document(text, "peer.toml", load_part))
    return profile.battery, profile.source, (("peer.dbc", peer.dbc()),)


@cache
def of_bundled(name):
    loaded = load_profile(name)
    return loaded.profile.battery, loaded.profile.source, tuple((f.name, f.read_text()) for f in loaded.dbc_files)


@cache
def with_ivt():
    orion = load_profile("orion-bms-2")
    document = read_document(f'include = ["ivt-s"]\n{orion.text}', "orion-with-ivt.toml", load_part)
    profile = understand(document)
    files = [Path(each) for each in (*orion.profile.source.dbc, *load_part("ivt-s").values["source"]["dbc"])]
    return profile.battery, profile.source, tuple((f.name, f.read_text()) for f in map(bundled_file, files))


def bundled_file(path):
    return path if path.is_file() else load_profile("orion-bms-2").dbc_files[0].parent / path.name


CASES = [
    *(pytest.param(lambda make=make: of_peer(make), id=make().name) for make in PEERS),
    *(pytest.param(lambda name=name: of_bundled(name), id=name) for name in ("foxbms-2", "one-signal-a-cell")),
    pytest.param(with_ivt, id="orion-bms-2 with ivt-s"),
]


@st.composite
def readings(draw, battery):
    """Of every kind, with some cells and sensors missing."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    found = {
        "voltage": rng.uniform(2.6, 4.2, battery.n_cells),
        "temperature": rng.uniform(1.0, 60.0, battery.n_sensors),
        "balancing": rng.integers(0, 2, battery.n_cells).astype(float),
        "resistance": rng.uniform(1e-3, 4e-3, battery.n_cells),
        "current": rng.uniform(-100.0, 200.0, 1),
        "pack_voltage": rng.uniform(100.0, 800.0, 1),
        "soc": rng.uniform(0.0, 1.0, 1),
        "charger_voltage": rng.uniform(100.0, 800.0, 1),
        "charger_current": rng.uniform(-20.0, 0.0, 1),
        **{f"limit.{name}": rng.uniform(10.0, 200.0, 1) for name in battery.limits},
    }
    states = ("closed", "precharge", "fault", "charging", "balancing")
    for name in states:
        found[f"state.{name}"] = np.array([float(draw(st.booleans()))])
    return found


@cache
def databases_of(files):
    return [cantools.database.load_string(text, database_format="dbc", strict=False) for _, text in files]


@cache
def definitions_of(files):
    found = Definitions(())
    for name, text in files:
        found = found.joined(parse_definitions(text.encode(), name))
    return found


def spoken(speech, values, for_s):
    """Frames of so many seconds: time, id, data."""
    frames = []
    speech.begin(0.0)
    while speech.due_s < for_s:
        at_s = speech.due_s
        frames += [(round(at_s * 1e9), can_id, data) for can_id, data in speech.frames(at_s, values)]
    return frames


def steps_of(lanes):
    """Of each kind the largest step between two raw numbers."""
    found = {}
    for each in lanes.by_id.values():
        for lane in each:
            step = 0.0 if lane.layout.is_float else abs(lane.layout.scale)
            found[lane.kind] = max(found.get(lane.kind, 0.0), step)
    return found


def round_s(speech):
    return 2.0 * max(len(e.turns) * period_s for e, period_s in zip(speech._encoders, speech._periods_s, strict=True))


@pytest.mark.parametrize("case", CASES)
@SETTINGS
@given(data=st.data())
def test_what_was_sent_is_what_is_decoded_within_the_signals_resolution(case, data):
    battery, source, files = case()
    assert isinstance(source, DbcMapping)
    definitions = definitions_of(files)
    speech = FrameEncoder(battery, source, definitions)
    assert speech.not_encoded() == {}
    values = data.draw(readings(battery))
    frames = spoken(speech, values, round_s(speech))
    decoded = BatteryDecoder(battery, source, definitions).decode(frames_of(frames))
    for kind, step in steps_of(speech.lanes).items():
        got = np.full(len(values[kind]), np.nan)
        got[decoded[kind].index] = decoded[kind].value
        steps = 1.5 if any(entry.invalid for entry in source.cells.get(kind, ())) else 0.5  # one more beside a code
        np.testing.assert_allclose(got, values[kind], atol=1e-9 + steps * step, err_msg=kind)


@pytest.mark.parametrize("case", CASES)
@SETTINGS
@given(data=st.data())
def test_cantools_decodes_every_frame_to_the_same_numbers(case, data):
    battery, source, files = case()
    definitions = definitions_of(files)
    speech = FrameEncoder(battery, source, definitions)
    databases = databases_of(files)
    values = data.draw(readings(battery))
    frames = spoken(speech, values, round_s(speech))
    decoder = BatteryDecoder(battery, source, definitions)
    for t_ns, can_id, raw in frames[:: max(1, len(frames) // 60)]:
        message = message_of(databases, can_id)
        theirs = message.decode(raw, decode_choices=False, allow_truncated=True)
        ours = decoder.decode(frames_of([(t_ns, can_id, raw)]))
        for lane in speech.lanes.by_id[can_id]:
            name = next((each for each in lane.signal_names if each in theirs), None)
            if name is None or lane.kind not in ours or lane.kind.startswith("state."):
                continue
            signal = message.get_signal_by_name(name)
            number = (theirs[name] - signal.offset) / signal.scale
            expected = number * lane.layout.scale + lane.layout.offset
            got = ours[lane.kind].value
            if lane.entry is not None and (lane.entry.invalid or lane.flag) and np.isnan(got).any():
                continue
            assert np.isclose(got, expected, rtol=1e-9, atol=1e-9).any(), (lane.kind, name)


def message_of(databases, can_id):
    for database in databases:
        try:
            return database.get_message_by_frame_id(can_id & 0x7FFFFFFF)
        except KeyError:
            continue
    raise AssertionError(hex(can_id))


@pytest.mark.parametrize("name", ["foxbms-2", "one-signal-a-cell", "orion-bms-2"])
@SETTINGS
@given(data=st.data())
def test_what_is_missing_is_told_as_missing_and_all_else_is_told(name, data):
    battery, source, files = of_bundled(name)
    definitions = definitions_of(files)
    speech = FrameEncoder(battery, source, definitions)
    values = data.draw(readings(battery))
    lost = data.draw(st.sets(st.integers(0, battery.n_cells - 1), max_size=30))
    values["voltage"][list(lost)] = np.nan
    frames = spoken(speech, values, round_s(speech))
    decoded = BatteryDecoder(battery, source, definitions).decode(frames_of(frames))["voltage"]
    known = set(decoded.index[np.isfinite(decoded.value)].tolist())
    assert known == set(range(battery.n_cells)) - lost


def test_the_newest_values_reach_a_measurement_with_their_own_times():
    battery, source, files = of_bundled("foxbms-2")
    definitions = definitions_of(files)
    speech = FrameEncoder(battery, source, definitions)
    values = {"voltage": np.linspace(3.0, 4.0, battery.n_cells), "current": np.array([12.0])}
    frames = spoken(speech, values, 3.0)
    decoder, assembler = BatteryDecoder(battery, source, definitions), Assembler(battery, source)
    measured = assembler.feed(decoder.decode(frames_of(frames)))[-1]
    np.testing.assert_allclose(measured.voltage_v, values["voltage"], atol=0.0006)
    assert measured.current_a == pytest.approx(12.0, abs=0.006)
    assert np.ptp(measured.voltage_t_ns) > 0.9e9  # one round of multiplexed frames


def test_foxbms_says_the_time_of_a_round_where_others_say_that_of_a_frame(tmp_path):
    file = tmp_path / "a.dbc"
    head = (
        'VERSION ""\nNS_ :\nBS_:\nBU_: B\nBO_ 1 M: 8 B\n SG_ N : 0|8@1+ (1,0) [0|0] "" B\n'
        ' SG_ U : 8|16@1+ (1,0) [0|0] "mV" B\nBA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;\n'
        'BA_DEF_DEF_ "GenMsgCycleTime" 0;\n'
    )
    times = 'BA_ "GenMsgCycleTime" BO_ 1 {};\n'
    text = (
        '[battery]\nname="a"\nsegments=[100]\n[source]\ndbc="a.dbc"\n'
        '[[source.voltage]]\nsignal="U"\nnumbers={cell="N"}\n'
    )
    profile = understand(read_document(text, "a.toml", load_part))
    for named_ms, expected_s in ((500, 0.5), (5000, 0.05)):
        file.write_text(head + times.format(named_ms))
        speech = FrameEncoder(profile.battery, profile.source, load_definitions(file))
        frames = spoken(speech, {"voltage": np.full(100, 3.7)}, 3.0)
        assert np.diff([t for t, _, _ in frames]) / 1e9 == pytest.approx(expected_s)
