"""A small store is read while a change of it waits for the disk."""

import sqlite3
import threading
from contextlib import closing

from app.sessions.storage.database import BLACKBOXES
from app.sessions.storage.own_database import Store
from tests.service_process import WAIT_S, until


def test_who_reads_does_not_wait_for_a_change_that_another_program_holds_up(tmp_path):
    store, changes = Store(tmp_path / "x.sqlite", BLACKBOXES), []
    change = threading.Thread(target=lambda: changes.append(store.change("DELETE FROM blackboxes", ())))
    with closing(sqlite3.connect(tmp_path / "x.sqlite", isolation_level=None)) as other:
        other.execute("BEGIN EXCLUSIVE")
        change.start()
        until(store._lock.locked)
        assert store.rows("SELECT count(*) FROM blackboxes") == [(0,)]
        assert changes == [], "it waits still"
        other.execute("ROLLBACK")
    change.join(WAIT_S)
    assert changes == [0]
    store.close()
