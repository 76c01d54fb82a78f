"""Black boxes are read while a change of them waits for the disk."""

import sqlite3
import threading
from contextlib import closing

from app.sessions.black_box_store import BlackBoxStore, StoredBox
from app.words import Message, rendered
from tests.service_process import WAIT_S, until

BOX = StoredBox("1", 1.0, None, "trip", "trip", None, rendered(Message("cell-undervoltage")), True)


def test_who_reads_does_not_wait_for_a_change_that_another_program_holds_up(tmp_path):
    store, changes = BlackBoxStore(tmp_path / "x.sqlite"), []
    change = threading.Thread(target=lambda: changes.append(store.add(BOX, {"all": "of it"})))
    with closing(sqlite3.connect(tmp_path / "x.sqlite", isolation_level=None)) as other:
        other.execute("BEGIN EXCLUSIVE")
        change.start()
        until(store._lock.locked)
        assert store.stored() == []
        assert changes == [], "it waits still"
        other.execute("ROLLBACK")
    change.join(WAIT_S)
    assert changes == [True]
    assert store.get("1") == {"all": "of it"}
    store.close()
