"""GET snapshot says the same as when snapshots were dictionaries: six of a short drive, recorded then.

New keys may come; none of the recorded ones may go, or say something else.
"""

import json
import math
from pathlib import Path

from app.api.encoding.encoder import snapshot_json
from app.live.pipeline_factory import PipelineFactory
from app.sources.items import CanFault, CanItem, LinkChange
from app.telemetry.service_state import ServiceState
from firmware_protocol.messages import EventCode, EventMessage, Ident, MessageType, Reply

RECORDED = json.loads((Path(__file__).parents[4] / "vectors" / "snapshots.json").read_text(encoding="utf-8"))
SERVICE = ServiceState(None, None, 3, None)
WALL_NS = 1_700_000_000_000_000_000
BY_CAN = bytes([0x10, 0x27, 0xC0, 0x8A]) + (-250).to_bytes(4, "little", signed=True)


def short_drive(pipeline, master):
    """A minute of driving with one of everything: yields (name, snapshot)."""
    yield "nothing", pipeline.tick(500_000_000, WALL_NS + 500_000_000).snapshot
    for link in ("rs232", "can"):
        pipeline.feed(LinkChange(0, WALL_NS, link, "open"))
    yield "can alone", pipeline.feed(CanItem(600_000_000, WALL_NS + 600_000_000, 0x100, BY_CAN)).snapshot
    pipeline.feed(CanFault(700_000_000, WALL_NS + 700_000_000, "warning", 3, 97, 5))
    identity = Reply(MessageType.IDENT, 4, 0, data=Ident((1, 2, 3), boots=7).to_bytes())
    pipeline.feed(master.item(MessageType.REPLY, identity.to_body()))
    pipeline.feed(master.config())
    master.set("r_fs", [150 + i for i in range(96)])
    master.set("c", [2500 - i for i in range(96)])
    for name, raw in {
        "n_slaves": 8,
        "dod": 123456789,
        "charger.fan_duty": 77,
        "charger.v_set": 3990,
        "charger.state": 0,
    }.items():
        master.set(name, [raw])
    for step in range(600):
        set_sample(master, step)
        if step % 10 == 0:
            for start in range(440, 1884, 361):
                pipeline.feed(master.windows((start, 361)))
            pipeline.feed(master.windows((2392, 398)))
        if step == 320:
            trip = EventMessage(EventCode.TRIP_V_MIN, 0, 17, 24000, 25000)
            pipeline.feed(master.item(MessageType.EVENT, trip.to_body()))
            master.set("status.flags", [0])
        snapshot = pipeline.feed(master.frame()).snapshot
        pipeline.predict()
        if step in (0, 250, 599):
            yield f"step {step}", snapshot
    t_ns = master.t_ns + 12_000_000_000
    yield "aged", pipeline.tick(t_ns, WALL_NS + t_ns).snapshot


def set_sample(master, step):
    current_a = 60 + 50 * math.sin(step / 7)
    counts = [round((3.75 - step * 2e-5 - current_a * 0.003 - 0.0003 * (i % 12)) * 1e4) for i in range(96)]
    if step > 300:
        counts[17], counts[40] = 24_000, 0
    master.set("v", counts)
    master.set("v_tot", [round(sum(counts) / 100)])
    master.set("t", [25 + i % 5 + (21 if i == 30 and step > 200 else 0) for i in range(96)])
    master.set("i_fs", [round(current_a * 100)])
    for pack in range(8):
        master.set(f"slave[{pack}].cvr", counts[pack * 12 : pack * 12 + 12])
        master.set(f"slave[{pack}].status", [pack % 3])


def differences(recorded, now, path=""):
    if isinstance(recorded, dict) and isinstance(now, dict):
        for name, value in recorded.items():
            yield from differences(value, now.get(name, "(gone)"), f"{path}/{name}")
    elif isinstance(recorded, list) and isinstance(now, list) and len(recorded) == len(now):
        for i, (before, after) in enumerate(zip(recorded, now, strict=True)):
            yield from differences(before, after, f"{path}[{i}]")
    elif isinstance(recorded, float) and isinstance(now, int | float):
        if not math.isclose(now, recorded, rel_tol=1e-9, abs_tol=2e-6):
            yield f"{path}: {recorded} is now {now}"
    elif recorded != now and not path.endswith("/text"):  # of a message: its code and arguments are the contract
        yield f"{path}: {recorded!r} is now {now!r}"


def test_every_key_and_number_is_as_it_was_recorded(master):
    chain = PipelineFactory("coulomb", "samsung-25r-10p").pipeline("serial", "/dev/x", "virtual:x")
    said = {name: json.loads(snapshot_json(snapshot, SERVICE)) for name, snapshot in short_drive(chain, master)}
    assert said.keys() == RECORDED.keys()
    assert list(differences(RECORDED, said)) == []


def test_a_changed_number_and_a_missing_key_are_found():
    assert list(differences({"a": [1.0, None], "b": 1}, {"a": [1.1, None]})) == [
        "/a[0]: 1.0 is now 1.1",
        "/b: 1 is now '(gone)'",
    ]
