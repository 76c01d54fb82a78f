"""The formats for other programs, each read back by a reader that is not ours where there is one."""

import json
import re
import struct
import subprocess
import xml.etree.ElementTree as ElementTree
import zlib
from importlib import import_module
from pathlib import Path
from zipfile import ZipFile

import can
import numpy as np
import pytest
from pyarrow import parquet

from app.cli import main
from app.errors import ConfigError
from app.sessions.export.export import export
from app.sessions.export.formats import FORMATS
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.recorder import Recorder
from app.sources.recordings.can_log import read_frames
from app.telemetry import Event
from app.words import Message
from tests.node import node

WALL_S = 1_790_000_000
MONO_NS = 5_000 * 10**9
ROOT = Path(__file__).resolve().parents[5]
READ_MCAP = ROOT / "frontend" / "fixtures" / "read_mcap.mjs"
SIGNALS = ["v[36]", "v[2]", "i_fs", "estimate.soc[0]"]


@pytest.fixture
def session(recorder: Recorder, stream):
    """20 s with a gap of 10 s in the middle, CAN, an event and two laps."""
    info = recorder.start("friday", {"driver": "Anna", "vehicle": "E5"})
    stream.feed(recorder, 100)
    stream.skip(100)
    stream.feed(recorder, 100)
    for i in range(50):
        can_id = 0x100 if i % 2 else 0x18FF50E5 | 1 << 31
        recorder.can_frame(MONO_NS + i * 10**8, WALL_S * 10**9 + i * 10**8, can_id, bytes([i] * (i % 9)))
    told = Message("verbatim", text="cell too low")
    recorder.event(MONO_NS + 10**9, Event(0, "trip", "v_min", told, cell=36))
    for at_s in (4, 25):
        recorder.marker(MONO_NS + at_s * 10**9, 0, "lap", kind="lap")
    recorder.flush()
    with SessionFile(info.path) as session:
        yield session


@pytest.mark.parametrize(("name", "reader"), [("candump", can.CanutilsLogReader), ("blf", can.BLFReader)])
def test_can_logs_are_read_by_python_can(session: SessionFile, tmp_path: Path, name: str, reader: type) -> None:
    path = tmp_path / f"log{FORMATS[name].suffix}"
    export(session, path, name, t_from_s=WALL_S + 1, t_to_s=WALL_S + 2)
    with reader(str(path)) as log:
        messages = list(log)
    expected = list(session.can_frames(WALL_S + 1, WALL_S + 2))
    assert len(expected) == 11
    assert [(m.arbitration_id | m.is_extended_id << 31, bytes(m.data)) for m in messages] == [
        (frame.can_id, frame.data) for frame in expected
    ]
    assert [m.timestamp for m in messages] == pytest.approx([session.unix_s(f.t_mono_ns) for f in expected], abs=2e-3)


@pytest.mark.parametrize(("from_s", "to_s"), [(None, None), (1.0, 2.0)])
@pytest.mark.parametrize("name", ["candump", "asc", "blf"])
def test_a_can_log_tells_how_far_it_is(
    recorder: Recorder, tmp_path: Path, monkeypatch, name: str, from_s: float | None, to_s: float | None
) -> None:
    monkeypatch.setattr("app.sessions.export.can_log.PROGRESS_EVERY", 1)
    info = recorder.start("friday")
    for i in range(50):
        recorder.can_frame(info.started_mono_ns + i * 10**8, info.started_wall_ns + i * 10**8, 0x100, bytes([i]))
    recorder.stop()
    recorder.flush()
    told: list[tuple[int, int]] = []
    begin_s = info.started_wall_ns / 1e9
    t_from_s, t_to_s = (None if at_s is None else begin_s + at_s for at_s in (from_s, to_s))
    with SessionFile(info.path) as session:
        path = tmp_path / f"a{FORMATS[name].suffix}"
        export(
            session,
            path,
            name,
            t_from_s=t_from_s,
            t_to_s=t_to_s,
            on_progress=lambda done, of: told.append((done, of)),
        )
    assert len(told) > 5
    assert told == sorted(told)
    assert len({of for _, of in told}) == 1
    assert told[-1][0] == told[-1][1]


@pytest.mark.parametrize("name", ["candump", "asc", "blf"])
def test_a_range_without_can_frames_is_said_and_leaves_no_file(session: SessionFile, tmp_path: Path, name: str) -> None:
    with pytest.raises(ConfigError, match="CAN frames"):
        export(session, tmp_path / "log", name, t_from_s=WALL_S + 20)
    assert not (tmp_path / "log").exists()


def test_an_asc_log_is_read_by_python_can(session: SessionFile, tmp_path: Path) -> None:
    export(session, tmp_path / "log.asc", "asc")
    with can.ASCReader(str(tmp_path / "log.asc")) as log:
        messages = list(log)
    assert [(m.arbitration_id | m.is_extended_id << 31, bytes(m.data)) for m in messages] == [
        (frame.can_id, frame.data) for frame in session.can_frames()
    ]
    assert np.diff([m.timestamp for m in messages]) == pytest.approx(0.1, abs=1e-3)


def test_mcap_is_read_by_what_foxglove_and_lichtblick_read_it_with(
    session: SessionFile, stream, tmp_path: Path
) -> None:
    pytest.importorskip("mcap")
    export(session, tmp_path / "a.mcap", "mcap", signals=SIGNALS)
    printed = subprocess.run([node(), READ_MCAP, tmp_path / "a.mcap"], check=True, capture_output=True)
    topics = json.loads(printed.stdout)
    assert {name: topic["schema"] for name, topic in topics.items()} == {
        "/v": "voltwall.Numbers",
        "/i_fs": "voltwall.Number",
        "/estimate.soc": "voltwall.Numbers",
        "/age": "voltwall.Number",
        "/events": "foxglove.Log",
    }
    voltages = topics["/v"]["messages"]
    assert (topics["/v"]["unit"], len(voltages)) == ("V", 200)
    assert int(voltages[1]["time_ns"]) == pytest.approx((WALL_S + 0.1) * 1e9, abs=1e3)
    value = voltages[1]["value"]
    assert (len(value), value[3]) == (37, None)  # JSON's word for NaN
    assert [value[2], value[36]] == pytest.approx([stream.voltages[1][cell] * 1e-4 for cell in (2, 36)])
    currents = [message["value"] for message in topics["/i_fs"]["messages"]]
    assert currents[:100] == pytest.approx([each * 0.01 for each in stream.currents[:100]])
    events = topics["/events"]["messages"]
    assert [(each["message"], each["level"]) for each in events] == [("cell too low", 5), ("lap", 2), ("lap", 2)]
    assert events[0]["timestamp"] == {"seconds": WALL_S + 1, "nanos": 0}


def test_mdf_is_read_by_asammdf(session: SessionFile, stream, tmp_path: Path, monkeypatch) -> None:
    asammdf = pytest.importorskip("asammdf")
    monkeypatch.setattr("app.sessions.export.table.PIECE_S", 3.0)
    export(session, tmp_path / "a.mf4", "mf4", signals=SIGNALS)
    with asammdf.MDF(tmp_path / "a.mf4") as file:
        voltage, current = file.get("v[36]"), file.get("i_fs")
        assert file.start_time.timestamp() == WALL_S
    assert (voltage.unit, current.unit) == ("V", "A")
    sent = [i for i, each in enumerate(stream.voltages) if each]
    assert voltage.timestamps == pytest.approx(0.1 * np.array(sent), abs=1e-5)
    assert voltage.samples == pytest.approx([stream.voltages[i][36] * 1e-4 for i in sent])
    assert current.samples == pytest.approx([stream.currents[i] * 0.01 for i in sent])


def test_mdf_tells_what_happened_and_whose_session_it_was(session: SessionFile, tmp_path: Path) -> None:
    asammdf = pytest.importorskip("asammdf")
    laps = [WALL_S + 4.0, WALL_S + 14.5, WALL_S + 25.0]
    export(session, tmp_path / "a.mf4", "mf4", signals=["i_fs"], lap_times_s=laps)
    with asammdf.MDF(tmp_path / "a.mf4") as file:
        events = [(each.value, each.name, each.comment) for each in file.events]
        header = file.header
        assert (header.author, header.subject) == ("Anna", "E5")
        assert session.info.id in header.description
        assert '<e name="driver">Anna</e>' in header.comment
    assert [at_s for at_s, _, _ in events] == pytest.approx([1, 4, 14.5, 25], abs=1e-3)
    assert [each[1:] for each in events] == [("v_min", "cell too low"), ("lap", "lap"), ("lap", "lap"), ("lap", "lap")]
    export(session, tmp_path / "b.mf4", "mf4", signals=["i_fs"], lap_times_s=laps, t_to_s=WALL_S + 10)
    with asammdf.MDF(tmp_path / "b.mf4") as file:
        assert [each.value for each in file.events] == pytest.approx([1, 4], abs=1e-3)


@pytest.mark.parametrize("name", ["csv", "parquet", "mf4", "ld"])
def test_the_chosen_names_are_in_the_file(session: SessionFile, tmp_path: Path, name: str) -> None:
    if name == "mf4":
        pytest.importorskip("asammdf")
    path = tmp_path / f"a.{name}"
    export(session, path, name, signals=SIGNALS, names="pack")
    read = {"csv": _csv_names, "parquet": parquet.read_schema, "mf4": _mf4_names, "ld": read_ld}[name]
    found = read(path).names if name == "parquet" else list(read(path))
    assert [each for each in found if each not in ("time_s", "elapsed_s", "uptime_s", "age", "time")] == [
        "pack4_cell1_v",
        "pack1_cell3_v",
        "i_fs",
        "pack1_cell1_estimate_soc",
    ]


def _csv_names(path: Path) -> list[str]:
    return path.read_text().partition("\n")[0].split(",")


def _mf4_names(path: Path) -> list[str]:
    with import_module("asammdf").MDF(path) as file:
        return [channel.name for group in file.groups for channel in group.channels]


def read_ld(path: Path) -> dict[str, tuple[str, int, np.ndarray]]:
    """A reader of the public description of .ld files: unit, rate and values of every channel of the chain."""
    data = path.read_bytes()
    (at,) = struct.unpack_from("<I", data, 8)
    found = {}
    while at:
        _, following, data_at, n, _, kind, size, rate_hz = struct.unpack_from("<4I4H", data, at)
        shift, multiplier, scale, decimals = struct.unpack_from("<4h", data, at + 24)
        name = data[at + 32 : at + 64].rstrip(b"\0").decode()
        unit = data[at + 72 : at + 84].rstrip(b"\0").decode()
        assert (kind, size) == (7, 4)
        values = (np.frombuffer(data, "<f4", n, data_at) / scale * 10.0**-decimals + shift) * multiplier
        found[name] = (unit, rate_hz, values)
        at = following
    return found


def test_ld_has_every_channel_at_one_rate_with_gaps_left_empty(session: SessionFile, stream, tmp_path: Path) -> None:
    export(session, tmp_path / "a.ld", "ld", signals=SIGNALS)
    channels = read_ld(tmp_path / "a.ld")
    assert list(channels) == SIGNALS
    unit, rate_hz, values = channels["v[36]"]
    assert (unit, rate_hz, len(values)) == ("V", 10, 300)
    assert values[:100] == pytest.approx([each[36] * 1e-4 for each in stream.voltages[:100]], rel=1e-6)
    assert np.isnan(values[102:199]).all()
    assert values[200:] == pytest.approx([each[36] * 1e-4 for each in stream.voltages[200:]], rel=1e-6)
    head = (tmp_path / "a.ld").read_bytes()
    for text in (b"Anna", b"E5", b"21/09/2026", b"14:13:20", b"friday"):
        assert text in head[:11336]


def test_laps_stand_beside_the_ld_file_as_beacons(session: SessionFile, tmp_path: Path) -> None:
    path = tmp_path / "a.ldx"
    export(session, path, "ldx", signals=["i_fs"])
    root = ElementTree.parse(path).getroot()
    assert [float(marker.attrib["Time"]) for marker in root.iter("Marker")] == pytest.approx([4e6, 25e6])
    details = {each.attrib["Id"]: each.attrib["Value"] for each in root.iter("String")}
    assert details == {"Total Laps": "3", "Fastest Time": "0:21.000", "Fastest Lap": "2"}  # not the 4 s before it
    with pytest.raises(ConfigError, match="a session with laps"):
        export(session, tmp_path / "b.ldx", "ldx", signals=["i_fs"], t_to_s=WALL_S + 3)
    export(session, path, "ldx", lap_times_s=[WALL_S + 10, WALL_S + 20])
    root = ElementTree.parse(path).getroot()
    assert [float(marker.attrib["Time"]) for marker in root.iter("Marker")] == pytest.approx([10e6, 20e6])
    for begin_s, fastest in ((WALL_S + 4, "1"), (WALL_S + 6, None)):  # a lap by itself; none that is whole
        export(session, path, "ldx", signals=["i_fs"], t_from_s=begin_s)
        found = {each.attrib["Id"]: each.attrib["Value"] for each in ElementTree.parse(path).getroot().iter("String")}
        assert found.get("Fastest Lap") == fastest


def test_motec_is_one_zip_with_samples_and_laps(session: SessionFile, tmp_path: Path) -> None:
    export(session, tmp_path / "a.zip", "motec", signals=["i_fs"])
    for name in ("ld", "ldx"):
        export(session, tmp_path / f"a.{name}", name, signals=["i_fs"])
    with ZipFile(tmp_path / "a.zip") as archive:
        assert archive.namelist() == [f"{session.info.id}.ld", f"{session.info.id}.ldx"]
        for name in ("ld", "ldx"):
            assert archive.read(f"{session.info.id}.{name}") == (tmp_path / f"a.{name}").read_bytes()
    export(session, tmp_path / "b.zip", "motec", signals=["i_fs"], t_to_s=WALL_S + 3)
    with ZipFile(tmp_path / "b.zip") as archive:
        assert archive.namelist() == [f"{session.info.id}.ld"]


@pytest.mark.parametrize("name", sorted(FORMATS.keys() - {"ldx", "candump", "asc", "blf"}))
def test_a_session_without_samples_gives_a_file(recorder: Recorder, tmp_path: Path, name: str) -> None:
    if name in ("mcap", "mf4"):
        pytest.importorskip({"mcap": "mcap", "mf4": "asammdf"}[name])
    info = recorder.start()
    recorder.flush()
    with SessionFile(info.path) as session:
        path = tmp_path / f"empty{FORMATS[name].suffix}"
        export(session, path, name, signals=["v[0]"])
    assert path.is_file()


@pytest.fixture
def simulated(recorder: Recorder, stream):
    info = recorder.start("demo", {"source": "simulator"})
    stream.feed(recorder, 100)
    recorder.can_frame(MONO_NS, WALL_S * 10**9, 0x100, b"1")
    for at_s in (2, 6):
        recorder.marker(MONO_NS + at_s * 10**9, 0, "lap", kind="lap")
    recorder.flush()
    with SessionFile(info.path) as session:
        yield session


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("car", ["simulated", "session"])
def test_a_simulated_car_is_marked_in_every_format(request, tmp_path: Path, car: str, name: str) -> None:
    if name in ("mcap", "mf4"):
        pytest.importorskip({"mcap": "mcap", "mf4": "asammdf"}[name])
    path = tmp_path / f"a{FORMATS[name].suffix}"
    export(request.getfixturevalue(car), path, name, signals=["i_fs"])
    content = path.read_bytes()
    if name == "motec":
        with ZipFile(path) as archive:
            content = b"".join(archive.read(each) for each in archive.namelist())
    if name == "blf":
        content = b"".join(_blf_objects(content))
    assert (b"simulat" in content.lower()) is (car == "simulated")


@pytest.mark.parametrize("name", sorted(FORMATS.keys() - {"ldx", "motec"}))
@pytest.mark.parametrize("car", ["simulated", "session"])
def test_what_was_simulated_stays_so_when_it_is_imported(request, tmp_path: Path, car: str, name: str) -> None:
    if name in ("mcap", "mf4"):
        pytest.importorskip({"mcap": "mcap", "mf4": "asammdf"}[name])
    path = tmp_path / f"a{FORMATS[name].suffix}"
    export(request.getfixturevalue(car), path, name)
    assert main(["sessions", "import", str(path), "--data", str(tmp_path / "data")]) == 0
    [imported] = (tmp_path / "data" / "sessions").glob("*.sqlite")
    with SessionFile(imported) as found:
        assert (found.info.metadata.get("source") == "simulator") is (car == "simulated")


@pytest.mark.parametrize("name", ["asc", "blf"])
def test_frames_of_a_simulated_car_keep_their_times(simulated: SessionFile, tmp_path: Path, name: str) -> None:
    path = tmp_path / f"a.{name}"
    export(simulated, path, name)
    exported = [time_s for time_s, *_ in read_frames(path)]
    recorded = [simulated.unix_s(frame.t_mono_ns) for frame in simulated.can_frames()]
    assert exported == pytest.approx(recorded, abs=2e-3)


def _blf_objects(content: bytes) -> list[bytes]:
    """The containers of a BLF file, decompressed: each begins with LOBJ, of kind 10, its zlib stream after 32 bytes."""
    parts = content.split(b"LOBJ")[1:]
    return [
        zlib.decompressobj().decompress(part[28:]) for part in parts if part[28:30] in (b"x\x9c", b"x\xda", b"x\x01")
    ]


def test_the_simulated_mark_is_a_column_of_ones(simulated: SessionFile, tmp_path: Path) -> None:
    export(simulated, tmp_path / "a.csv", "csv", signals=["i_fs"])
    header, *rows = (tmp_path / "a.csv").read_text().splitlines()
    assert header.split(",")[-3:] == ["simulated", "age (s)", "time"]
    assert {row.split(",")[-3] for row in rows} == {"1"}


def test_the_layout_for_foxglove_names_topics_that_an_export_holds(session: SessionFile) -> None:
    layout = json.loads((ROOT / "docs" / "examples" / "foxglove-battery.json").read_text())
    panels = layout["configById"]
    topics = {path["value"].partition(".value")[0] for panel in panels.values() for path in panel.get("paths", [])}
    assert topics == {f"/{field}" for field in ("i_fs", "v", "t", "estimate.soc", "soc")}
    assert {topic.removeprefix("/") for topic in topics} <= {each.field for each in session.signals.of_table()}
    named = re.findall(r"(?:Plot|RosOut)!\w+", json.dumps(layout["layout"]))
    assert sorted(named) == sorted(panels)
    assert len(panels) == 5
