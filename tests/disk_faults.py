# ruff: noqa: B023  a step is done before the loop goes on
"""What writes files in a process whose disk fails: `python -m tests.disk_faults FOLDER SHARE SEED [SCENARIO...]`.

tests/integration/faulty_disk.c is preloaded. Each scenario runs once to count its calls of the disk, then once for each
call and error, with this one call failing. A step that is refused is asked for again: it has to work then; looking at
what is there is a step too. At the end everything that was acknowledged is there, and where something failed that
mattered it was said (an error, a log line).
"""

import contextlib
import ctypes
import errno
import json
import logging
import os
import random
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

import app  # noqa: F401  before numpy: it keeps each process to one thread
from app.clock import Clock
from app.configuration.configuration_store import ConfigurationStore
from app.configuration.history import ConfigHistory
from app.errors import AppError
from app.live.learned_state import LearnedState, load_learned_state, save_learned_state
from app.live.prediction import LearnedCells
from app.live.remembered_charge import RememberedCharge
from app.sessions.catalogue import Catalogue
from app.sessions.event_log import EventLog
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.recorder import Recorder
from app.sessions.recording.session_names import RecordingPlan, load_plan, save_plan
from app.sessions.retention import Retention, RetentionRule
from app.sessions.swaps import SwapFile
from app.sources.connections import Connections, load_connections, save_connections
from app.sources.loaded_battery import team_battery
from app.sources.recordings.import_mapping import ImportMapping, ImportMappingStore
from app.telemetry import Event
from app.words import Message
from firmware_protocol.config_image import default_image, with_value
from firmware_protocol.eeprom import newest
from firmware_protocol.framing import FrameDecoder, encode_frame
from firmware_protocol.memory_map import CONFIG_SIZE
from firmware_protocol.messages import Reply, Result, Store, Write, decode_message, encode_request
from simulator.board import Board
from simulator.eeprom import SIZE, Eeprom
from simulator.errors import SimulatorError
from simulator.master import VirtualMaster
from simulator.vehicle import PASS_S
from tests.fake_clock import FunctionClock

WRITE, SYNC, OPEN, RENAME, TRUNCATE, UNLINK = 1, 2, 4, 8, 16, 32
FAULTS = (
    (WRITE, errno.EIO), (WRITE, errno.ENOSPC), (WRITE, 0), (SYNC, errno.EIO), (OPEN, errno.EMFILE),
    (OPEN, errno.EACCES), (RENAME, errno.ENOSPC), (TRUNCATE, errno.EIO), (UNLINK, errno.EIO),
)  # fmt: skip
TRIES = 3
OLD = with_value(default_image(), "v_cell_chrg", 4.1)
NEW = with_value(OLD, "v_cell_chrg", 4.12)
WALL_NS = 1_790_000_000 * 10**9
Step = Callable[[], object]

disk = ctypes.CDLL(None)


class Broken(Exception):
    """A promise was."""


def must(holds: object, what: str) -> None:
    if not holds:
        raise Broken(what)


def retried(step: Step, said: list[str]) -> None:
    """Do a step; one that is refused in words is asked for again."""
    for left in reversed(range(TRIES)):
        try:
            step()
        except (AppError, OSError, SimulatorError) as error:
            said.append(str(error))
            must(str(error).strip(), "an error without a word")
            must(left, f"refused again: {error}")
        else:
            return


def recorder(folder: Path, said: list[str]) -> Iterator[Step]:
    """Two sessions of frames; what was flushed is there, what was taken is there at the end."""
    made = Recorder(folder, Clock(), version="test")
    taken: dict[str, list[bytes]] = {}
    sent = 0

    def batch() -> None:
        nonlocal sent
        for _ in range(5):
            raw = encode_frame(3, sent & 255, sent, sent.to_bytes(4, "little") + bytes(100))[1:-1]
            made.frame(sent * 10**7, WALL_NS + sent * 10**7, 0, raw, True)
            taken[made.status.session.id].append(raw)
            sent += 1

    def begin() -> None:
        taken.setdefault(made.start("a race").id, [])

    def split() -> None:
        taken.setdefault(made.split().id, [])

    yield begin
    for number in range(3):
        batch()
        made.event(sent * 10**7, Event(WALL_NS, "info", "marked", Message("verbatim", text="marked")))
        yield made.flush
        if number == 1:
            yield split
    made.stop()
    yield made.flush
    state = made.status
    made.close()
    must(state.error is None, f"it stays stalled: {state.error}")

    def whole() -> None:
        for name, frames in taken.items():
            path = folder / f"{name}.sqlite"
            if not path.exists() and not frames:
                continue
            with SessionFile(path) as session:
                must([frame.raw for frame in session.frames()] == frames, f"frames of {name} are lost")
                must(session.info.is_closed, f"{name} is not closed")
                must(session.problems() == [], str(session.problems()))

    yield whole


def history(folder: Path, said: list[str]) -> Iterator[Step]:
    """Signed records: what was acknowledged stays, all are genuine."""
    kept: list[int] = []

    def sound() -> None:
        found = ConfigHistory(folder).records()
        must(len(set(kept)) == len(kept), f"numbers twice: {kept}")
        must(set(kept) <= {record.number for record in found}, f"of {kept} only {[each.number for each in found]}")
        must(all(record.is_genuine for record in found), "a record of our own is called forged")

    for number in range(3):
        made = ConfigHistory(folder)
        yield lambda: kept.append(made.append(WALL_NS, "ada", "write", "draft", f"try {number}", OLD, NEW, "done"))
        yield sound


def eeprom(folder: Path, said: list[str]) -> Iterator[Step]:
    """A store of the simulated master: the old configuration or the new one, the new one where it said done."""
    path = folder / "eeprom.bin"

    def stored(image: bytes, now_s: float) -> None:
        before = newest(path.read_bytes().ljust(SIZE, b"\xff")) if path.exists() else None
        master, decoder = VirtualMaster(Board(Eeprom(path), np.random.default_rng(1)), now_s), FrameDecoder()
        in_force = before.image if before else default_image()
        must(bytes(master.image[:CONFIG_SIZE]) == in_force, "it starts with another configuration")
        replies: list[Reply] = []
        for sequence, request in enumerate((Write(0, image), Store())):
            kind, body = encode_request(request)
            master.receive(encode_frame(kind, sequence, 0, body), now_s)
            while len(replies) <= sequence:
                now_s += PASS_S
                master.measure(now_s, PASS_S, 0.0)
                while (raw := master.next_frame(now_s)) is not None:
                    replies += [each for each in map(decode_message, decoder.feed(raw)) if isinstance(each, Reply)]
        if replies[-1].result != Result.DONE:
            raise SimulatorError("the EEPROM failed")

    def sound(image: bytes) -> None:
        there = newest(bytes(Eeprom(path).content))
        must(there is not None and there.image == image, "what was stored is not there")

    for number, image in enumerate((OLD, NEW)):
        yield lambda: stored(image, 100.0 * number)
        yield lambda: sound(image)


def profiles(folder: Path, said: list[str]) -> Iterator[Step]:
    """Configuration profiles with their versions."""
    made, saved = ConfigurationStore(folder, Clock()), []
    for image in (OLD, NEW):
        yield lambda: saved.append(made.save("wet", image, comment="c", who="ada"))
        yield lambda: must(made.load("wet").image == image, "the newest is another one")
        yield lambda: must(made.load("wet", saved[-1].version).image == image, "the version is another one")
    yield lambda: made.save("dry", OLD, comment="", who="ada")
    yield lambda: made.delete("dry")
    must(made.names() == ["wet"], f"profiles: {made.names()}")


def settings(folder: Path, said: list[str]) -> Iterator[Step]:
    """Connections, the plan of the recordings, an import's profile: the old one or the new one, whole."""
    plan, imports = folder / "plan.json", ImportMappingStore(folder / "imports")
    before: Connections | None = None
    named = RecordingPlan()

    def either(old: object, new: object, save: Step, load: Callable[[], object]) -> None:
        try:
            save()
        except (OSError, AppError):
            must(load() in (old, new), "neither the old nor the new one")
            raise
        must(new in (load(), load()), "another one")  # one that cannot be read is ignored with a warning

    for number in range(2):
        chosen, event = Connections(serial=f"/dev/ttyUSB{number}"), RecordingPlan(event=f"race {number}")
        rig = ImportMapping(current="I", voltages=f"v{number}")
        yield lambda: either(before, chosen, lambda: save_connections(folder, chosen), lambda: load_connections(folder))
        yield lambda: either(named, event, lambda: save_plan(plan, event), lambda: load_plan(plan))
        yield lambda: imports.save("rig", rig)
        yield lambda: must(imports.load("rig") == rig, "another import profile")
        before, named = chosen, event


def events(folder: Path, said: list[str]) -> Iterator[Step]:
    """The event log over two starts."""
    for number in range(2):
        opened: list[EventLog] = []
        clock = FunctionClock(lambda: 0, lambda: 0)
        yield lambda: opened.append(EventLog(folder / "events.sqlite", clock))
        for k in range(3):
            opened[0].append(Event(WALL_NS + k, "info", "code", Message("verbatim", text=f"event {number} {k}")))
        wanted = {f"event {number} {k}" for k in range(3)}
        yield opened[0].flush
        yield lambda: must(opened[0].acknowledge(1, "ada"), "it cannot be acknowledged")
        yield lambda: must(wanted <= {event.text for event in opened[0].query()}, "events are lost")
        opened[0].close()


def stores(folder: Path, said: list[str]) -> Iterator[Step]:
    """Swaps of modules, and what the filter learned."""
    swaps = SwapFile(folder, team_battery().battery)
    yield lambda: swaps.add([3], WALL_NS / 1e9, "new", "ada", "red", [])
    yield lambda: must(len(swaps.read()) in (1, 2), "a swap is lost")
    path = folder / "learned.npz"
    for charge in (0.5, 0.6):
        cells = LearnedCells(np.zeros((6, 96)), np.zeros(96))
        save_learned_state(path, LearnedState(RememberedCharge(10, np.full(96, charge), np.full(96, 0.01)), cells))
    found = load_learned_state(path, 96)
    must(found is not None or said, "what was learned is lost without a word")


def retention(folder: Path, said: list[str]) -> Iterator[Step]:
    """Old sessions go to the trash and out of it; one that cannot go now goes the next time."""
    frozen = sorted((Path(__file__).parent / "unit/app/sessions/frozen").glob("session_*.sqlite"))
    for number, path in enumerate(frozen):
        yield lambda: shutil.copy(path, folder / f"2020010{number + 1}T000000Z.sqlite")
    catalogue = Catalogue(folder)
    days = 86_400 * 10**9

    def note(severity: str, message: object) -> None:
        said.append(str(message))

    last_ns = max((info.ended_wall_ns or info.started_wall_ns) for info in catalogue.list())
    kept = Retention(
        catalogue, RetentionRule(keep_days=1.0), note, FunctionClock(lambda: 0, lambda: last_ns + 3 * days)
    )
    for _ in range(2 * len(frozen)):
        kept.apply()
    left = list(folder.glob("*.sqlite"))
    yield lambda: must(not left, f"they stay: {left}")
    kept = Retention(
        catalogue, RetentionRule(keep_days=1.0), note, FunctionClock(lambda: 0, lambda: last_ns + 90 * days)
    )
    kept.apply()


def lake(folder: Path, said: list[str]) -> Iterator[Step]:
    """The season's lake of a session: built again after a refusal, it is whole."""
    from pyarrow import parquet

    from app.season.lake.build import build_lake, states
    from app.season.lake.place import LakeFolder

    path = max((Path(__file__).parent / "unit/app/sessions/frozen").glob("session_*.sqlite"))
    place = LakeFolder(folder / "lake")

    def build() -> None:
        built = build_lake(place, [path])
        must(not built.not_closed, "closed sessions are not")
        if built.failed:
            raise OSError(str(built.failed))

    def whole() -> None:
        there = [len(states(place)) for _ in range(2)]  # a file that is refused once would be made again
        must(1 in there, "the session is not in the lake")
        for file in folder.rglob("*.parquet"):
            parquet.read_table(file)
        must(not list(folder.rglob(".*.parquet-*")), "what was left unfinished stays")

    yield build
    yield whole


SCENARIOS = {each.__name__: each for each in (
    recorder, history, eeprom, profiles, settings, events, stores, retention, lake
)}  # fmt: skip


class Words(logging.Handler):
    """Keeps what is logged."""

    def __init__(self, said: list[str]) -> None:
        super().__init__(logging.INFO)
        self.said = said

    def emit(self, record: logging.LogRecord) -> None:
        self.said.append(record.getMessage())


def run(name: str, folder: Path, n: int, ops: int, error: int) -> tuple[int, str, list[str]]:
    """Run a scenario with a call that fails; return the calls it made, which one failed, what was said."""
    folder = Path(tempfile.mkdtemp(prefix=name, dir=folder))  # a thread of the run before may still write
    said: list[str] = []
    handler = Words(said)
    logging.getLogger().addHandler(handler)
    disk.fault_arm(n, ops, error)
    try:
        for step in SCENARIOS[name](folder, said):
            retried(step, said)
    finally:
        calls, fired = disk.fault_calls(), ctypes.string_at(disk.fault_fired()).decode()
        disk.fault_arm(0, 0, 0)
        if os.environ.get("KEEP") is None:
            shutil.rmtree(folder, ignore_errors=True)
        logging.getLogger().removeHandler(handler)
    return calls, fired, said


def main(folder: Path, share: float, seed: int, names: list[str]) -> int:
    """Run scenarios with each call failing, or a share of them by chance; print one line each."""
    disk.fault_fired.restype = ctypes.c_void_p
    disk.fault_calls.restype = ctypes.c_long
    logging.getLogger().setLevel(logging.INFO)
    logging.lastResort = None
    folder.mkdir(parents=True, exist_ok=True)
    chance, broken = random.Random(seed), 0
    for name in names or SCENARIOS:
        tried, silent = 0, set()
        for ops, error in FAULTS:
            total, _, _ = run(name, folder, 0, ops, 0)
            for n in range(1, total + 1):
                if chance.random() >= share:
                    continue
                try:
                    _, fired, said = run(name, folder, n, ops, error)
                except Exception as problem:  # noqa: BLE001  whatever it is breaks a promise
                    broken += 1
                    fired = ctypes.string_at(disk.fault_fired()).decode()
                    what = {"scenario": name, "fault": errno.errorcode.get(error, "short"), "call": n, "of": total}
                    print(
                        json.dumps(what | {"at": fired, "broken": f"{type(problem).__name__}: {problem}"}), flush=True
                    )
                else:
                    tried += 1
                    if not said:
                        silent.add(f"{fired.partition(' ')[0]} {Path(fired).name}")
        print(json.dumps({"scenario": name, "tried": tried, "silent": sorted(silent)}), flush=True)
    return 1 if broken else 0


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        sys.exit(main(Path(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3]), sys.argv[4:]))
