"""A small store is read while a change of it waits for the disk."""

import sqlite3
import threading
from contextlib import closing

import pytest

from app.sessions.storage.migrate import BLACKBOXES, PASSPORT
from app.sessions.storage.small_store import Store
from tests.service_process import WAIT_S, until


@pytest.mark.parametrize(("schema", "table"), [(BLACKBOXES, "blackboxes"), (PASSPORT, "swaps")])
def test_who_reads_does_not_wait_for_a_change_that_another_program_holds_up(tmp_path, schema, table):
    store, changes = Store(tmp_path / "x.sqlite", schema), []
    change = threading.Thread(target=lambda: changes.append(store.change(f"DELETE FROM {table}", ())))
    with closing(sqlite3.connect(tmp_path / "x.sqlite", isolation_level=None)) as other:
        other.execute("BEGIN EXCLUSIVE")
        change.start()
        until(store._lock.locked)
        assert store.rows(f"SELECT count(*) FROM {table}") == [(0,)]
        assert changes == [], "it waits still"
        other.execute("ROLLBACK")
    change.join(WAIT_S)
    assert changes == [0]
    store.close()
