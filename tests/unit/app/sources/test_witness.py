"""A second source of one battery: heard beside it, compared, and never mixed into it."""

from pathlib import Path

import numpy as np
import pytest

from app.battery.table_reader import ProfileError
from app.live.pipeline_factory import PipelineFactory
from app.sessions.export.can_log import write_candump
from app.sessions.export.table import SignalTable
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.recorder import Recorder
from app.sessions.replay import item_of, prepare
from app.sources.items import BUS_SHIFT, CanItem, LinkChange
from app.sources.loaded_battery import LoadedBattery, load_battery
from app.telemetry import Snapshot
from app.telemetry.aging import aged
from app.telemetry.encoding import plain
from tests.fake_clock import FunctionClock
from tests.peer_batteries import Peer, one_signal_a_cell
from tests.recorded.peer_sessions import write_profile

WITNESS = """
[[witness]]
name = "second"
bus = 1
dbc = "second.dbc"
[witness.current]
signal = "Pack_Current"
[witness.pack_voltage]
signal = "Pack_Voltage"
[[witness.voltage]]
signal = "V{cell}"
base = 1
"""
WALL_NS = 10**18


def battery() -> Peer:
    return one_signal_a_cell(8, 0, "V{}", "T{}", 0.0001, "V")


def loaded(folder: Path, text: str = WITNESS) -> LoadedBattery:
    peer = battery()
    (folder / "second.dbc").write_text(peer.dbc())
    return load_battery(str(write_profile(peer, folder, more=text)))


def frames(seconds: float, bus: int, *, seconds_from: float = 0.0, ampere: float = 0.0) -> list[CanItem]:
    """What the battery says; with `ampere` more of current, which stands in bytes 2 and 3 of its status."""
    found = []
    for t_ns, can_id, data in battery().frames(seconds):
        if t_ns < seconds_from * 1e9:
            continue
        if ampere and can_id == STATUS_ID:
            current = int.from_bytes(data[2:4], "little", signed=True) + round(10 * ampere)
            data = data[:2] + current.to_bytes(2, "little", signed=True) + data[4:]
        found.append(CanItem(t_ns + 1000 * bus, WALL_NS + t_ns, can_id | bus << BUS_SHIFT, data))
    return found


STATUS_ID = next(
    sent.can_id for sent in battery().sent if any(b.name == "Pack_Current" for turn in sent.turns for b in turn)
)


def after(source: LoadedBattery, items: list[CanItem]) -> Snapshot:
    """The newest snapshot after these items, in the order of their time."""
    pipeline = PipelineFactory("coulomb", None, source).pipeline("can", None, "virtual:a,virtual:b")
    pipeline.feed(LinkChange(0, WALL_NS, "can", "open"))
    pipeline.feed(LinkChange(0, WALL_NS, "can", "open", bus=1))
    outputs = [pipeline.feed(item) for item in sorted(items, key=lambda item: item.t_mono_ns)]
    newest = next(output.snapshot for output in reversed(outputs) if output.snapshot is not None)
    assert newest is not None
    return newest


def verdicts(snapshot: Snapshot) -> dict[str, bool | None]:
    assert snapshot.witnesses is not None
    return {reading.quantity: reading.verdict for reading in snapshot.witnesses[0].readings}


def test_two_that_say_the_same_agree_and_each_has_its_link(tmp_path: Path) -> None:
    snapshot = after(loaded(tmp_path), frames(6, 0) + frames(6, 1))
    (witness,) = snapshot.witnesses or ()
    assert (witness.name, witness.bus) == ("second", 1)
    assert verdicts(snapshot) == {"current": True, "pack_voltage": True, "voltage": True}
    assert witness.age_s is not None
    assert witness.age_s < 0.5
    assert witness.link is not None
    assert (witness.link.url, witness.link.state) == ("virtual:b", "live")
    assert snapshot.links.can.url == "virtual:a"
    assert abs(witness.link.frames - snapshot.links.can.frames) <= 1
    assert [alarm.code for alarm in snapshot.alarms] == []


def test_a_current_sensor_that_is_off_is_told_with_both_values_and_changes_nothing(tmp_path: Path) -> None:
    alone = after(loaded(tmp_path), frames(8, 0))
    snapshot = after(loaded(tmp_path), frames(8, 0) + frames(8, 1, ampere=90.0))
    reading = next(each for each in (snapshot.witnesses or ())[0].readings if each.quantity == "current")
    assert reading.verdict is False
    assert reading.value is not None
    assert reading.ours is not None
    assert reading.value - reading.ours == pytest.approx(90, abs=1)
    assert snapshot.accumulator.current_a == alone.accumulator.current_a
    np.testing.assert_array_equal(snapshot.cells.voltage_v, alone.cells.voltage_v)
    assert [alarm.code for alarm in snapshot.alarms] == ["witness-disagrees"]


def test_a_silent_witness_ages_alone(tmp_path: Path) -> None:
    snapshot = after(loaded(tmp_path), frames(16, 0) + frames(3, 1))
    (witness,) = snapshot.witnesses or ()
    assert witness.age_s == pytest.approx(13, abs=0.5)
    assert set(verdicts(snapshot).values()) == {None}
    assert snapshot.age_s.voltage is not None
    assert snapshot.age_s.voltage < 0.5
    assert [alarm.code for alarm in snapshot.alarms] == ["witness-silent"]


def test_a_silent_battery_is_not_spoken_for_by_its_witness(tmp_path: Path) -> None:
    source = loaded(tmp_path)
    pipeline = PipelineFactory("coulomb", None, source).pipeline("can", None, "virtual:a,virtual:b")
    for item in sorted(frames(3, 0) + frames(9, 1), key=lambda item: item.t_mono_ns):
        pipeline.feed(item)
    snapshot = pipeline.tick(9_000_000_000, WALL_NS).snapshot
    assert snapshot is not None
    assert snapshot.age_s.voltage is None or snapshot.age_s.voltage > 5
    assert (snapshot.witnesses or ())[0].age_s == pytest.approx(0.0, abs=0.5)
    assert None in verdicts(snapshot).values()


def test_a_witness_that_was_never_heard_is_no_alarm(tmp_path: Path) -> None:
    snapshot = after(loaded(tmp_path), frames(4, 0))
    assert (snapshot.witnesses or ())[0].age_s is None
    assert snapshot.alarms == ()


def test_a_snapshot_is_sent_with_the_ages_of_now_and_without_witnesses_where_there_are_none(tmp_path: Path) -> None:
    snapshot = after(loaded(tmp_path), frames(3, 0) + frames(3, 1))
    (before,) = snapshot.witnesses or ()
    (sent,) = plain(aged(snapshot, snapshot.t_mono_ns + 5 * 10**9))["witnesses"]
    assert sent["age_s"] == pytest.approx((before.age_s or 0.0) + 5.0)
    assert sent["link"]["age_s"] == pytest.approx(((before.link and before.link.age_s) or 0.0) + 5.0)
    assert [each["quantity"] for each in sent["readings"]] == ["current", "pack_voltage", "voltage"]
    alone = after(loaded(tmp_path, ""), frames(3, 0))
    assert "witnesses" not in plain(aged(alone, alone.t_mono_ns + 1))


def test_a_recorded_session_tells_both_again(tmp_path: Path) -> None:
    source = loaded(tmp_path)
    clock = FunctionClock(lambda: 0, lambda: WALL_NS)
    recorder = Recorder(tmp_path / "sessions", clock, version="0", battery=source)
    info = recorder.start()
    for item in sorted(frames(6, 0) + frames(6, 1, ampere=90.0), key=lambda item: item.t_mono_ns):
        recorder.can_frame(item.t_mono_ns, item.t_wall_ns, item.can_id, item.data)
    recorder.close()
    with SessionFile(info.path) as session:
        pipeline = PipelineFactory("coulomb", None, session.loaded_battery).pipeline("replay", "rs232", "can")
        prepare(pipeline, session)
        outputs = [pipeline.feed(item_of(frame)) for frame in session.can_frames()]
        table = SignalTable(session, ["v[0]"])
        write_candump(table, tmp_path / "run.log")
    newest = next(output.snapshot for output in reversed(outputs) if output.snapshot is not None)
    assert verdicts(newest)["current"] is False
    (witness,) = newest.witnesses or ()
    assert witness.link is not None
    assert witness.link.frames > 300
    channels = {line.split()[1] for line in (tmp_path / "run.log").read_text().splitlines()}
    assert channels == {"can0", "can1"}


def test_its_dbc_is_kept_with_the_profile(tmp_path: Path) -> None:
    assert "second.dbc" in loaded(tmp_path).files


@pytest.mark.parametrize(
    ("text", "where", "why"),
    [
        ('[[witness]]\nbus = 1\ndbc = "second.dbc"\n', "witness[0].name", "called"),
        ('[[witness]]\nname = "a"\nbus = 9\ndbc = "second.dbc"\n', "witness[0].bus", "0..3"),
        ('[[witness]]\nname = "a"\nkind = "master"\n', "witness[0].kind", "DBC"),
        (
            '[[witness]]\nname = "a"\ndbc = "second.dbc"\n[witness.current]\nsign = "x"\n',
            "witness[0].current.sign",
            "signal",
        ),
        (WITNESS + WITNESS, "witness[1].name", "another name"),
    ],
)
def test_what_is_wrong_is_told_by_its_own_field(tmp_path: Path, text: str, where: str, why: str) -> None:
    with pytest.raises(ProfileError) as error:
        loaded(tmp_path, text)
    assert error.value.path == where
    assert why in str(error.value)
    assert error.value.line is not None


def test_a_bus_of_a_witness_that_is_lost_is_told_with_its_number_and_the_battery_goes_on(tmp_path: Path) -> None:
    pipeline = PipelineFactory("coulomb", None, loaded(tmp_path)).pipeline("can", None, "virtual:a,virtual:b")
    pipeline.feed(LinkChange(0, WALL_NS, "can", "open"))
    pipeline.feed(LinkChange(0, WALL_NS, "can", "open", bus=1))
    for item in sorted(frames(3, 0) + frames(3, 1), key=lambda item: item.t_mono_ns):
        pipeline.feed(item)
    lost = pipeline.feed(LinkChange(3 * 10**9, WALL_NS, "can", "lost", "unplugged", bus=1))
    assert [(event.severity, event.code) for event in lost.events] == [("watch", "of-bus")]
    assert lost.events[0].message.args["bus"] == 1
    snapshot = pipeline.tick(3 * 10**9, WALL_NS).snapshot
    assert snapshot is not None
    assert snapshot.links.can.state == "live"


def test_a_frame_of_a_bus_that_nobody_listens_to_changes_nothing(tmp_path: Path) -> None:
    with_third = after(loaded(tmp_path), frames(4, 0) + frames(4, 1) + frames(4, 2, ampere=200.0))
    alone = after(loaded(tmp_path), frames(4, 0) + frames(4, 1))
    assert with_third.links.can.frames == alone.links.can.frames
    assert verdicts(with_third) == verdicts(alone)
