"""What the service says of the machine that it runs on."""

from websockets.sync.client import connect

READS_ONLY = True


def test_readers_disk_and_clock_are_told(service):
    with service.client() as client:
        before = client.get("/system").raise_for_status().json()
        assert (before["listens_on"], before["addresses"]) == ("127.0.0.1", [])
        assert before["disk"]["free_bytes"] > 0
        assert before["clock"]["was_set"] is False
        with connect(service.base_url.replace("http", "ws") + "/api/v1/live", max_size=1 << 22) as live:
            live.recv(timeout=10)
            readers = client.get("/system").json()["readers"]
            assert len(readers) == len(before["readers"]) + 1
            assert (readers[-1]["role"], readers[-1]["address"]) == ("engineer", "127.0.0.1")
