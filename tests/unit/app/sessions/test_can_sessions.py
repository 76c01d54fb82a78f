"""Signals of a car on CAN alone: what its messages carry is in the series, the exports, the lists."""

import numpy as np
import pytest

from app.sessions.export.table import SignalTable
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.recorder import Recorder
from firmware_protocol.can_tables import TxMessage, message_bytes, tx_messages, with_tx_messages
from firmware_protocol.config_image import default_image
from firmware_protocol.memory_map import FIELDS, MASTER_SIZE

MONO_NS, WALL_NS = 5_000 * 10**9, 1_790_000_000 * 10**9
SUMMARY = tx_messages(default_image())[1]  # soc, v_tot, i_fs


def image(step: int) -> bytearray:
    memory = bytearray(MASTER_SIZE)
    FIELDS["soc"].pack_into(memory, (9000 - step,))
    FIELDS["v_tot"].pack_into(memory, (36000 + step % 7,))
    FIELDS["i_fs"].pack_into(memory, (1000 - 20 * step,))
    for offset in (1896, 1897):
        memory[offset] = step % 250
    return memory


def send(recorder: Recorder, message: TxMessage, steps: range, period_ms: int = 100) -> None:
    for step in steps:
        at_ns = step * period_ms * 1_000_000
        data = message_bytes(message, image(step))
        recorder.can_frame(MONO_NS + at_ns, WALL_NS + at_ns, message.can_id, data)


@pytest.mark.parametrize("closed", [True, False])
def test_a_session_of_can_frames_alone_has_their_signals(recorder: Recorder, closed: bool) -> None:
    """90 s: a chunk and what came after it."""
    info = recorder.start()
    for start in (0, 300, 610):
        send(recorder, SUMMARY, range(start, {0: 300, 300: 610, 610: 900}[start]))
        recorder.flush()
    if closed:
        recorder.close()
    with SessionFile(info.path) as session:
        assert session.signal_names() == ["i_fs", "v_tot", "soc"]
        found = session.series(["i_fs", "v_tot", "soc", "v[0]"])
        rows = np.concatenate([piece.values for piece in SignalTable(session).rows()])
    assert found["i_fs"].minimum == pytest.approx([10 - 0.2 * i for i in range(900)])
    assert found["soc"].time_s == pytest.approx([1_790_000_000 + i / 10 for i in range(900)])
    assert len(found["v[0]"].time_s) == 0
    assert rows.shape == (900, 4)
    assert not np.isnan(rows[:, :3]).any()
    assert np.isnan(rows[:, 3]).all()  # age of the cell voltages: there are none


def test_tables_that_were_changed_count_from_then_on(recorder: Recorder) -> None:
    info = recorder.start()
    send(recorder, SUMMARY, range(10))
    changed = TxMessage(3, True, 0x321, False, 100, 2, (1896, 1897, *[0xFFFF] * 6))
    recorder.config(MONO_NS + 10**9, WALL_NS, with_tx_messages(default_image(), [changed]), "changed")
    send(recorder, changed, range(10, 20))
    recorder.close()
    with SessionFile(info.path) as session:
        assert len(session.series(["i_fs"])["i_fs"].time_s) == 10
        assert session.series(["v[0]"])["v[0]"].minimum == pytest.approx([i * 257e-4 for i in range(10, 20)])


def test_can_counts_only_while_the_serial_link_is_silent(recorder: Recorder, stream) -> None:
    info = recorder.start()
    stream.feed(recorder, 20)
    send(recorder, SUMMARY, range(1, 60))
    recorder.close()
    with SessionFile(info.path) as session:
        current = session.series(["i_fs"])["i_fs"]
        times_s = current.time_s[np.isfinite(current.minimum)] - 1_790_000_000
        soc = session.series(["estimate.soc[0]"])["estimate.soc[0]"]
    assert times_s == pytest.approx([*np.arange(20) / 10, *np.arange(29, 60) / 10])
    assert len(soc.time_s) == 20
