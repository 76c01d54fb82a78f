"""Whatever comes off the wires, the chain goes on: it never raises and never makes up a number."""

import json
import math
from dataclasses import asdict, replace
from functools import cache

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import example, given, settings

from app.api.encoding.encoder import snapshot_json
from app.api.schemas.snapshot import SnapshotOut
from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import make_estimator
from app.live.pipeline import Output, Pipeline
from app.sources.items import CanItem, Item, LinkChange, SerialItem
from app.sources.master.source import MasterSource
from app.telemetry.service_state import ServiceState
from app.words import render
from firmware_protocol.framing import FrameDecoder, decode_chunk, encode_frame
from firmware_protocol.memory_map import CAN_ID_EXTENDED, FIELDS, MASTER_SIZE, N_CELLS
from firmware_protocol.messages import MessageType
from tests.campaign import examples

SERVICE = ServiceState(None, None, 3, None)
WALL_NS = 1_700_000_000_000_000_000
BLOCKS = ((0, 420), (420, 20), (440, 200), (1884, 204), (2280, 116), (2396, 300), (2982, 2))

filter_name = "coulomb", "fused", "ekf"
window = st.one_of(
    st.sampled_from(BLOCKS).flatmap(
        lambda block: st.tuples(st.just(block[0]), st.binary(min_size=1, max_size=block[1]))
    ),
    st.tuples(st.integers(0, MASTER_SIZE - 1), st.binary(max_size=64)),
    st.tuples(st.integers(0, 0xFFFF), st.binary(max_size=16)),
)
extreme = st.sampled_from([b"\x00", b"\xff", b"\x7f", b"\x80"]).flatmap(
    lambda byte: st.sampled_from(BLOCKS).map(lambda block: (block[0], byte * block[1]))
)
body = st.one_of(
    st.lists(st.one_of(window, extreme), max_size=5).map(
        lambda windows: b"".join(o.to_bytes(2, "little") + len(d).to_bytes(2, "little") + d for o, d in windows)[:512]
    ),
    st.binary(max_size=64),
)
frame = st.tuples(
    st.one_of(st.sampled_from(list(MessageType)), st.integers(0, 255)),
    st.integers(0, 255),
    st.one_of(st.integers(0, 0xFFFFFFFF), st.integers(0, 10_000)),
    body,
)
can_id = st.one_of(
    st.sampled_from([0x100, 0x1806E5F4 | CAN_ID_EXTENDED, 0x18FF50E5 | CAN_ID_EXTENDED]), st.integers(0, 0xFFFFFFFF)
)
change = st.tuples(st.sampled_from(["rs232", "can"]), st.sampled_from(["connecting", "open", "lost"]))
step = st.one_of(
    st.tuples(st.just("frame"), frame),
    st.tuples(
        st.just("measured"), st.tuples(st.integers(-(1 << 31), (1 << 31) - 1), st.binary(min_size=24, max_size=24))
    ),
    st.tuples(st.just("noise"), st.binary(max_size=64)),
    st.tuples(st.just("can"), st.tuples(can_id, st.binary(max_size=64), st.booleans())),
    st.tuples(st.just("change"), change),
    st.tuples(st.just("tick"), st.none()),
)
# seconds between two steps: the monotonic clock stands or goes on, the wall clock does what it likes
pause = st.tuples(st.sampled_from([0.0, 0.001, 0.1, 2.0, 20.0, 7200.0]), st.sampled_from([0, -86400, 86400]))


@cache
def cell():
    return load_cell("samsung-25r-10p")


def new_pipeline(name: str) -> Pipeline:
    return Pipeline(
        MasterSource("serial", "/dev/x", "virtual:x"),
        lambda: make_estimator(name, cell(), N_CELLS),
        filter_name=name,
        cell_name="samsung-25r-10p",
    )


def items(kind: str, what, t_ns: int, wall_ns: int) -> list[Item]:
    if kind == "frame":
        frame_type, sequence, uptime_ms, payload = what
        raw = encode_frame(frame_type, sequence, uptime_ms, payload)[1:-1]
        return [SerialItem(t_ns, wall_ns, decode_chunk(raw))]
    if kind == "measured":  # a whole fast frame, so that the estimator is reached often
        current_raw, pattern = what
        image = bytearray(MASTER_SIZE)
        FIELDS["i_fs"].pack_into(image, (current_raw,))
        image[1896:2088] = pattern * 8
        image[2290:2386] = pattern * 4
        blocks = ((1884, 204), (2280, 116))
        payload = b"".join(o.to_bytes(2, "little") + n.to_bytes(2, "little") + image[o : o + n] for o, n in blocks)
        raw = encode_frame(MessageType.DATA, 0, t_ns // 1_000_000, payload)[1:-1]
        return [SerialItem(t_ns, wall_ns, decode_chunk(raw))]
    if kind == "noise":
        return [SerialItem(t_ns, wall_ns, found) for found in FrameDecoder().feed(b"\0" + what + b"\0")]
    if kind == "can":
        return [CanItem(t_ns, wall_ns, what[0], what[1], sent=what[2])]
    if kind == "change":
        return [LinkChange(t_ns, wall_ns, what[0], what[1], "why" if what[1] == "lost" else None)]
    return []


def assert_honest(output: Output) -> None:
    snapshot = output.snapshot
    if snapshot is None:
        return
    text = snapshot_json(snapshot, SERVICE)
    said = json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    SnapshotOut.model_validate(said)
    for name in ("voltage_v", "temperature_degc", "soc", "soc_sigma", "ocv_v", "residual_v", "resistance_ohm"):
        values = getattr(snapshot.cells, name)
        assert values.shape == (N_CELLS,)
        assert not np.isinf(values).any()
    for number in [*asdict(snapshot.accumulator).values(), *asdict(snapshot.age_s).values()]:
        assert not isinstance(number, float) or math.isfinite(number)
    for age_s in (*said["age"].values(), *(link["age_s"] for link in said["links"].values())):
        assert age_s is None or age_s >= 0
    known = [v for v in said["cells"]["voltage_v"] if v is not None]
    assert all(0 < v <= 6.5535 for v in known)
    assert all(0 <= v <= 1 for v in said["cells"]["soc"] if v is not None)
    assert all(v >= 0 for v in said["cells"]["soc_sigma"] if v is not None)
    assert said["accumulator"]["loaded_cells"] == len(known)
    assert (said["accumulator"]["voltage_min_v"] is None) <= (not known)
    for event in output.events:
        assert render(event.message)
        assert event.cell is None or 0 <= event.cell < N_CELLS


@settings(max_examples=examples(150), deadline=None)
@given(st.sampled_from(filter_name), st.lists(st.tuples(step, pause), max_size=40))
def test_no_item_breaks_the_chain_or_makes_up_a_number(name, steps):
    pipeline = new_pipeline(name)
    t_ns, wall_ns = 1_000_000_000, WALL_NS
    for (kind, what), (mono_s, wall_jump_s) in steps:
        t_ns += int(mono_s * 1e9)
        wall_ns += int((mono_s + wall_jump_s) * 1e9)
        for item in items(kind, what, t_ns, wall_ns):
            assert_honest(pipeline.feed(item))
        if kind == "tick":
            assert_honest(pipeline.tick(t_ns, wall_ns))


@settings(max_examples=examples(40), deadline=None)
@given(st.lists(st.tuples(step, pause), max_size=30))
@example([(("frame", (MessageType.DATA, 0, 11_011, b"")), (0.0, 0)), (("tick", None), (20.0, 0))])  # uptime runs ahead
def test_after_any_mess_a_good_master_is_shown_as_it_is(steps):
    pipeline = new_pipeline("fused")
    t_ns = 1_000_000_000
    for (kind, what), (mono_s, _) in steps:
        t_ns += int(mono_s * 1e9)
        for item in items(kind, what, t_ns, WALL_NS):
            pipeline.feed(item)
    pattern = (37000).to_bytes(2, "little") * 12
    for i in range(10):
        t_ns += 100_000_000
        good = replace(items("measured", (1000, pattern), t_ns, WALL_NS + i)[0], waited_max_ns=0)  # read in time
        snapshot = pipeline.feed(good).snapshot
    assert snapshot.cells.voltage_v == pytest.approx(3.7)
    assert snapshot.accumulator.current_a == pytest.approx(10)
    assert not np.isnan(snapshot.cells.soc).any()
