"""`voltwall.connect` and `voltwall.open` on a running service."""

import asyncio
from itertools import islice

import pytest

import voltwall

READS_ONLY = True


def test_snapshots_come_one_after_the_other(service):
    live = voltwall.connect(service.base_url, rate=20.0)
    assert len(live.latest()["cells"]["voltage_v"]) == 96
    with live:
        first, second = islice(live, 2)
    assert second["seq"] > first["seq"]


def test_snapshots_come_in_an_event_loop(service):
    async def take() -> list[dict]:
        found = []
        async with voltwall.connect(service.base_url) as live:
            async for snapshot in live:
                found.append(snapshot)
                if len(found) == 2:
                    return found
        return found

    first, second = asyncio.run(take())
    assert second["seq"] > first["seq"]


def test_a_session_of_a_service_is_opened_here(service):
    with service.client() as client:
        session_id = client.get("sessions").json()["sessions"][0]["id"]
    with voltwall.open(f"{service.base_url}/sessions/{session_id}") as session:
        assert session.n_cells == 96
    with pytest.raises(voltwall.VoltwallError, match="nothing"):
        voltwall.open(f"{service.base_url}/sessions/nothing")


def test_a_service_that_is_not_there_is_said_so():
    live = voltwall.connect("http://127.0.0.1:1")
    with pytest.raises(OSError, match="refused"):
        live.latest()
    with pytest.raises(OSError, match=r"refused|Connect"), live:
        pass
    with pytest.raises(voltwall.VoltwallError, match="url"):
        voltwall.connect("ftp://127.0.0.1")
    with pytest.raises(RuntimeError, match="with"):
        next(iter(live))
