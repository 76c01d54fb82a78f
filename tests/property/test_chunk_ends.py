"""Wherever the commits and chunks of a session end: one row an instant, a sample and its estimate together."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from app.sessions.export.table import SignalTable
from app.sessions.info import SessionInfo
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.session_writer import SessionWriter, TableRow
from firmware_protocol.framing import encode_frame
from firmware_protocol.memory_map import FIELDS, MASTER_SIZE
from firmware_protocol.messages import Data, MessageType, Window
from firmware_protocol.older_maps import FIRST_MAP
from tests.campaign import examples

START_NS = 5_000 * 10**9
STEP_MS = 21_000  # three samples a chunk
RESET_MS = 1_000  # by which the uptime goes back where the master has started anew
VOLTAGES = (1896, 192)
# Of each sample: whether the master has started anew before it and shows what; how many samples its estimate comes
# behind; whether a commit ends after its frame and after its estimate.
SAMPLES = st.lists(
    st.tuples(st.none() | st.integers(0, 70_000), st.integers(0, 4), st.booleans(), st.booleans()),
    min_size=1,
    max_size=14,
)


def frame_row(k: int, uptime_ms: int) -> TableRow:
    image = bytearray(MASTER_SIZE)
    FIELDS["v"].pack_into(image, (36_000 + k,) * 96)
    offset, length = VOLTAGES
    body = Data((Window(offset, bytes(image[offset : offset + length])),)).to_body()
    t_ns = START_NS + k * STEP_MS * 10**6
    return "frames", (t_ns, t_ns, 0, 1, encode_frame(MessageType.DATA, k, uptime_ms, body)[1:-1])


def estimate_row(k: int, uptime_ms: int) -> TableRow:
    soc = np.full(96, k / 100)
    return "estimates", (START_NS + k * STEP_MS * 10**6, uptime_ms, soc, soc)


def batches(samples: list[tuple[int | None, int, bool, bool]]) -> Iterator[list[TableRow]]:
    """What comes from the links and, in order and later, from the pipeline, cut into commits."""
    uptimes: list[int] = []
    for restarted_ms, *_ in samples:
        before = uptimes[-1] + STEP_MS if uptimes else 1_000
        is_known = restarted_ms is not None and not (uptimes and -RESET_MS <= restarted_ms - uptimes[-1] <= 0)
        uptimes.append(restarted_ms if is_known else before)  # a new start at the uptime of the old one is not seen
    batch: list[TableRow] = []
    estimated = 0
    for k in range(len(samples) + 5):
        if k < len(samples):
            batch.append(frame_row(k, uptimes[k]))
            if samples[k][2]:
                yield batch
                batch = []
        while estimated < min(k + 1, len(samples)) and estimated + samples[estimated][1] <= k:
            batch.append(estimate_row(estimated, uptimes[estimated]))
            if samples[estimated][3]:
                yield batch
                batch = []
            estimated += 1
    if batch:
        yield batch


def write(path: Path, samples: list[tuple[int | None, int, bool, bool]], is_closed: bool) -> None:
    path.touch()
    writer = SessionWriter(SessionInfo(path.stem, path, "a", START_NS, START_NS, map_hash=FIRST_MAP))
    for batch in batches(samples):
        writer.write(batch)
        writer.close_chunk_if_due(batch[-1][1][0])
    if is_closed:
        end_ns = START_NS + len(samples) * STEP_MS * 10**6
        writer.close(end_ns, end_ns)
    writer.abandon()


@settings(max_examples=examples(100))
@example(samples=[(0, 0, False, False), (0, 0, False, False)], is_closed=False, piece_s=240.0)
@given(samples=SAMPLES, is_closed=st.booleans(), piece_s=st.sampled_from((7.0, 240.0)))
def test_a_row_holds_a_sample_and_its_estimate(samples, is_closed: bool, piece_s: float) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "20261123T120000Z.sqlite"
        write(path, samples, is_closed)
        with SessionFile(path) as session:
            table = SignalTable(session, ["v[0]", "estimate.soc[0]"])
            pieces = list(table.rows(piece_s))
    values = np.concatenate([rows.values for rows in pieces])
    elapsed_s = np.concatenate([rows.elapsed_s for rows in pieces])
    k = np.arange(len(samples))
    np.testing.assert_allclose(elapsed_s, k * STEP_MS / 1e3)
    np.testing.assert_allclose(values[:, 0], 3.6 + k * 1e-4)
    np.testing.assert_allclose(values[:, 1], k / 100)
