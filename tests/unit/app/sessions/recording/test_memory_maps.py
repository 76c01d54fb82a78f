"""A master of another memory map: its session names that map, and tells what the master meant."""

from collections.abc import Iterator

import pytest

from app.clock import Clock
from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import make_estimator
from app.live.pipeline import Pipeline
from app.sessions.errors import RecordingFailed
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.auto_recorder import AutoRecorder
from app.sessions.replay import item_of, prepare
from app.sources.master.source import MasterSource
from app.telemetry import Event
from firmware_protocol.config_image import default_image, unit_value, with_value
from firmware_protocol.memory_map import MAP_HASH
from firmware_protocol.messages import Ident, MessageType, Reply
from firmware_protocol.older_maps import FIRST_MAP, first_image

CELL = load_cell("samsung-25r-10p")
OF_FIRST_MAP = bytes.fromhex(FIRST_MAP)
UNKNOWN_MAP = bytes(8)


@pytest.fixture
def events() -> list[Event]:
    return []


@pytest.fixture
def recorder(tmp_path, events) -> Iterator[AutoRecorder]:
    recorder = AutoRecorder(tmp_path / "sessions", automatic=True, on_event=events.append, clock=Clock())
    yield recorder
    recorder.close()


def fresh_pipeline() -> Pipeline:
    return Pipeline(MasterSource("serial"), lambda: make_estimator("coulomb", CELL, 96), filter_name="c", cell_name="c")


@pytest.fixture
def pipeline() -> Pipeline:
    return fresh_pipeline()


def play(recorder, pipeline, item) -> None:
    recorder.on_item(item)
    recorder.on_output(pipeline.feed(item))


def samples(recorder, pipeline, master, n: int, ms: int = 100) -> None:
    for _ in range(n):
        play(recorder, pipeline, master.frame(ms))
        recorder.flush()


def introduce(recorder, pipeline, master, map_hash: bytes) -> None:
    reply = Reply(MessageType.IDENT, 1, 0, data=Ident((0, 9, 0), map_hash=map_hash).to_bytes())
    play(recorder, pipeline, master.item(MessageType.REPLY, reply.to_body()))


def read(recorder: AutoRecorder, signal: str, session_id: str | None = None) -> tuple[str, list[float]]:
    recorder.flush()
    path = recorder.session.path
    with SessionFile(path if session_id is None else path.with_name(f"{session_id}.sqlite")) as session:
        assert session.problems() == []
        return session.info.map_hash, session.series([signal])[signal].minimum.tolist()


@pytest.mark.parametrize("before_s", [0.2, 130.0])  # two chunks are packed by our own map until the master tells its
def test_a_session_is_read_by_the_map_that_the_master_tells(recorder, pipeline, master, before_s):
    master.set("dod", [3_600_000])  # mA s
    play(recorder, pipeline, master.config())
    samples(recorder, pipeline, master, 14, round(before_s * 100))
    introduce(recorder, pipeline, master, OF_FIRST_MAP)
    samples(recorder, pipeline, master, 3)
    assert read(recorder, "dod") == (FIRST_MAP, pytest.approx([1.0] * 17))


def test_a_master_of_our_own_map_changes_nothing(recorder, pipeline, master):
    master.set("dod", [1_000_000])  # uAh
    introduce(recorder, pipeline, master, MAP_HASH)
    samples(recorder, pipeline, master, 3)
    assert read(recorder, "dod") == (MAP_HASH.hex(), pytest.approx([1.0] * 3))


def test_a_map_that_nobody_knows_is_named_all_the_same(recorder, pipeline, master):
    samples(recorder, pipeline, master, 2)
    introduce(recorder, pipeline, master, UNKNOWN_MAP)
    samples(recorder, pipeline, master, 2)
    assert read(recorder, "v[0]") == (UNKNOWN_MAP.hex(), pytest.approx([3.7] * 4))


def test_another_map_on_the_same_line_begins_a_session_of_its_own(recorder, pipeline, master, events):
    master.set("dod", [3_600_000])
    introduce(recorder, pipeline, master, OF_FIRST_MAP)
    samples(recorder, pipeline, master, 2)
    first = recorder.session.id
    master.set("dod", [2_000_000])
    introduce(recorder, pipeline, master, MAP_HASH)
    samples(recorder, pipeline, master, 3)
    assert read(recorder, "dod", first)[0] == FIRST_MAP
    map_hash, drawn_ah = read(recorder, "dod")
    assert (map_hash, drawn_ah[-2:]) == (MAP_HASH.hex(), pytest.approx([2.0, 2.0]))
    assert [event.code for event in events] == ["recording-started", "recording-split"]


def test_where_no_new_session_can_be_made_it_is_tried_again(recorder, pipeline, master, monkeypatch):
    introduce(recorder, pipeline, master, OF_FIRST_MAP)
    samples(recorder, pipeline, master, 2)
    first = recorder.session.id

    def refuse(_):
        raise RecordingFailed("no")

    with monkeypatch.context() as context:
        context.setattr(recorder._recorder, "split", refuse)
        introduce(recorder, pipeline, master, MAP_HASH)
        samples(recorder, pipeline, master, 2)
        assert read(recorder, "v[0]")[0] == FIRST_MAP
        assert recorder.session.id == first
    samples(recorder, pipeline, master, 2)
    assert read(recorder, "v[0]")[0] == MAP_HASH.hex()


def test_the_next_session_is_of_the_map_that_is_known(recorder, pipeline, master):
    introduce(recorder, pipeline, master, OF_FIRST_MAP)
    samples(recorder, pipeline, master, 2)
    recorder.stop()
    recorder.start()
    samples(recorder, pipeline, master, 2)
    assert read(recorder, "v[0]")[0] == FIRST_MAP


def test_the_period_between_frames_is_told_as_the_master_meant_it(recorder, pipeline, master):
    """The recorder takes down the configuration in our own map; the session's signal is that of the master's."""
    image = first_image(with_value(default_image(), "telemetry_period", 250))
    master.image[: len(image)] = image
    introduce(recorder, pipeline, master, OF_FIRST_MAP)
    samples(recorder, pipeline, master, 1)
    recorder.on_output(pipeline.feed(master.config()))  # not recorded itself: the signal comes from the image
    samples(recorder, pipeline, master, 1)
    assert set(read(recorder, "conf.ts")[1]) == {250.0}
    with SessionFile(recorder.session.path) as session:
        assert [unit_value(each.image, "telemetry_period") for each in session.configs()] == [250]


def test_a_replay_from_the_middle_counts_charge_as_the_recorded_master_did(recorder, pipeline, master):
    """There the master does not say who it is."""
    introduce(recorder, pipeline, master, OF_FIRST_MAP)
    samples(recorder, pipeline, master, 1)
    recorder.stop()
    recorder.start()
    master.set("dod", [3_600_000])
    samples(recorder, pipeline, master, 2)
    again = fresh_pipeline()
    with SessionFile(recorder.session.path) as session:
        prepare(again, session)
        snapshots = [again.feed(item_of(frame)).snapshot for frame in session.frames()]
    assert [each.master.charge_drawn_ah for each in snapshots] == pytest.approx([1.0, 1.0])
