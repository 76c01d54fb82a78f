"""The machine around the service."""

import platform
import socket
import subprocess
import sys
from ipaddress import ip_address

import pytest

from app.service.host import ClockWatch, HighListener, addresses_of, disk_of, raise_descriptor_limit
from tests.fake_clock import FakeClock


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.5", "::1", "localhost"])
def test_nobody_reaches_a_service_on_loopback(host):
    assert addresses_of(host) == []


@pytest.mark.parametrize("host", ["192.168.4.1", "pit.local"])
def test_a_service_on_one_address_is_reached_there(host):
    assert addresses_of(host) == [host]


def test_a_service_on_every_address_names_each_once_and_no_loopback():
    found = addresses_of("0.0.0.0")
    assert len(set(found)) == len(found)
    assert not any(ip_address(address).is_loopback for address in found)


def test_disk_is_that_of_the_folder_and_unknown_where_there_is_none(tmp_path):
    disk = disk_of(tmp_path)
    assert 0 < disk["free_bytes"] <= disk["total_bytes"]
    assert disk_of(tmp_path / "nothing" / "here") is None


@pytest.mark.parametrize(("moved_s", "was_set"), [(0.0, False), (1.5, False), (-3600.0, True), (86400.0, True)])
def test_clock_that_was_set_is_noticed(moved_s, was_set):
    clock = FakeClock()
    watch = ClockWatch(clock)
    clock.advance(60)
    clock.set_wall(clock.wall_s() + moved_s)
    assert watch.moved_s() == pytest.approx(moved_s)
    assert watch.was_set is was_set


@pytest.mark.skipif(sys.platform == "win32", reason="its select takes every descriptor")
def test_connections_leave_the_descriptors_that_a_link_can_wait_for():
    limit = raise_descriptor_limit()
    if limit is not None and limit <= 1024:
        pytest.skip("this system gives no more descriptors")
    with HighListener() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        with socket.create_connection(listener.getsockname()) as client:
            connection, address = listener.accept()
            with connection:
                assert connection.fileno() >= 1024
                assert address == client.getsockname()
                client.sendall(b"ping")
                assert connection.recv(4) == b"ping"
                assert not connection.get_inheritable()


# Blocks of 1 MB with small ones that stay between them, after one of 24 MB was freed; tells what stays of them [MB].
LEAVES = """
from pathlib import Path
from app.service.host import release_freed_memory
CALL
def resident_mb():
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6
large = bytearray(24 << 20)
del large
before_mb = resident_mb()
blocks, small = [], []
for _ in range(64):
    blocks.append(bytearray(b"x") * (1 << 20))
    small.append(bytearray(600))
blocks.clear()
print(resident_mb() - before_mb)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="about its allocator")
def test_memory_of_large_blocks_goes_back_to_the_system():
    def left_mb(call):
        program = LEAVES.replace("CALL", call)
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
        return float(done.stdout)

    assert left_mb("") > 50  # else this test says nothing
    assert left_mb("release_freed_memory()") < 5


# 70 MB in small blocks, of which every fiftieth stays; prints what stays of them in memory [MB], before and after.
RETURNS = """
from pathlib import Path
from app.service.host import return_freed_memory
def resident_mb():
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6
before_mb = resident_mb()
blocks = [bytearray(700) for _ in range(100_000)]
kept = blocks[::50]
del blocks
freed_mb = resident_mb() - before_mb
return_freed_memory()
print(freed_mb, resident_mb() - before_mb)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="about its allocator")
def test_memory_between_blocks_in_use_goes_back_when_it_is_asked_for():
    done = subprocess.run([sys.executable, "-c", RETURNS], capture_output=True, text=True, check=True)
    freed_mb, after_mb = map(float, done.stdout.split())
    assert freed_mb > 40  # else this test says nothing
    assert after_mb < freed_mb / 2
