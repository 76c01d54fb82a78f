"""CAN logs that are cut or damaged: each import ends, with a session or with a reason, and another can begin."""

import random

import can
import pytest

from tests.campaign import campaign, of_size
from tests.unit.app.sessions.transfer.test_import_jobs import PROFILE, Watched, pipeline

FRAMES = 200
LOGS = of_size(9, 50, 150, 300)


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "theirs.blf"
    with can.BLFWriter(path) as writer:
        for number in range(FRAMES):
            data = bytes([number % 256] * 8)
            writer.on_message_received(can.Message(1_700_000_000 + number / 100, 0x100, False, data=data))
    return path.read_bytes()


def broken(log, seed):
    chance = random.Random(seed)
    body = bytearray(log)
    if seed % 3 == 0:
        return body[: chance.randrange(len(body))]
    for _ in range(chance.choice((1, 3, 20))):
        body[chance.randrange(len(body) if seed % 3 == 1 else min(400, len(body)))] = chance.randrange(256)
    return body


@campaign(60, 300, 600)
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # python-can leaves the file open
def test_every_import_of_a_broken_log_ends_named_and_another_can_begin(tmp_path, log):
    jobs = Watched(tmp_path, pipeline)
    for seed in range(LOGS):
        jobs.notes.clear()
        end = jobs.run(broken(log, seed), PROFILE, "theirs.blf")
        assert not end.is_running
        assert (end.session_id is None) != (end.error is None)
        assert jobs.notes == [("info", "session-imported") if end.error is None else ("warning", "import-failed")]
