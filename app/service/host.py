"""The machine the service runs on, as far as it matters in the pit: addresses, disk, clock."""

import contextlib
import ctypes
import shutil
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from ipaddress import IPv4Address, ip_address
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from app.clock import Clock
from app.errors import ConfigError
from app.words import Message

try:
    import fcntl
    import resource
except ImportError:  # Windows
    fcntl = resource = None  # type: ignore[assignment]

# One address in each range that a pit network may use: a datagram socket "connected" there sends nothing, and tells
# which of this machine's addresses would be used.
_PROBES = ("192.0.2.1", "10.255.255.254", "172.31.255.254", "192.168.255.254", "169.254.255.254")
_CLOCK_STEP_S = 2.0
_TIME_ERROR = 5  # adjtimex(2): the clock is not synchronised
_DESCRIPTORS = 8192  # what 4,000 readers and all else need
_SELECTABLE = 1024  # descriptors from here on cannot be waited for by select(2)
_MALLOPT = {  # mallopt(3): parameter and value
    -3: 1 << 18,  # M_MMAP_THRESHOLD: what is larger gets pages of its own, which go back when it is freed
    -1: 1 << 18,  # M_TRIM_THRESHOLD: so much may stay free at the end of the heap
    -8: 2,  # M_ARENA_MAX: heaps that the threads share
}


def raise_descriptor_limit() -> int | None:
    """Raise the limit on open files as far as the system lets this process; return it, None where there is none."""
    if resource is None:
        return None
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY:
        return None
    wanted = _DESCRIPTORS if hard == resource.RLIM_INFINITY else min(_DESCRIPTORS, hard)
    if soft < wanted:
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
            soft = wanted
    return soft


def release_freed_memory() -> None:
    """Let glibc return memory that is freed to the system.

    Else the threshold grows with each large block, and what an analysis took for a second stays between small
    blocks: 6 MB more in three hours. Other systems' allocators are left as they are.
    """
    if not sys.platform.startswith("linux"):
        return
    with contextlib.suppress(OSError, AttributeError):  # musl has none
        mallopt = ctypes.CDLL(None).mallopt
        for parameter, value in _MALLOPT.items():
            mallopt(parameter, value)


def return_freed_memory() -> None:
    """Return to the system at once what is free between blocks in use (glibc); takes up to a tenth of a second."""
    if not sys.platform.startswith("linux"):
        return
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


class HighListener(socket.socket):
    """A listening socket whose connections get high descriptors.

    The low ones are left to links and broker, whose drivers wait with select(2): one opened while a thousand readers
    are connected would else be lost at once.
    """

    def accept(self) -> tuple[socket.socket, Any]:
        """Take a connection; where the system gives no high descriptor it keeps the one that it has."""
        connection, address = super().accept()
        if fcntl is None:
            return connection, address
        try:
            high = fcntl.fcntl(connection.fileno(), fcntl.F_DUPFD_CLOEXEC, _SELECTABLE)
        except OSError:
            return connection, address
        connection.close()
        return socket.socket(fileno=high), address


def is_clock_synchronised() -> bool:
    """Return whether the system says that the network, or another clock, keeps its time; False where it cannot say."""
    if not sys.platform.startswith("linux"):
        return False
    state = ctypes.create_string_buffer(512)  # struct timex, of which nothing is set: its first word is 0
    try:
        return 0 <= int(ctypes.CDLL(None).adjtimex(state)) < _TIME_ERROR
    except (OSError, AttributeError):
        return False


def addresses_of(host: str) -> list[str]:
    """Return the IPv4 addresses under which other machines reach a service that listens on `host`; none on loopback."""
    try:
        listens_on = ip_address(host)
    except ValueError:
        return [] if host == "localhost" else [host]
    if listens_on.is_loopback:
        return []
    if not listens_on.is_unspecified:
        return [host]
    addresses: list[str] = []
    for probe in _PROBES:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            try:
                out.connect((probe, 9))
            except OSError:
                continue
            own = out.getsockname()[0]
        address = IPv4Address(own)
        if not (address.is_loopback or address.is_unspecified) and own not in addresses:
            addresses.append(own)
    return addresses


def disk_of(folder: Path) -> dict[str, int] | None:
    """Return free and total bytes of the disk that holds `folder`; None where it cannot be asked."""
    try:
        usage = shutil.disk_usage(folder)
    except OSError:
        return None
    return {"free_bytes": usage.free, "total_bytes": usage.total}


class ClockWatch:
    """Tells how far the wall clock was moved since the service started, by the monotonic clock."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._offset_ns = clock.wall_ns() - clock.monotonic_ns()

    def moved_s(self) -> float:
        """Return how far the wall clock was set on (positive) or back since the start [s]."""
        return (self._clock.wall_ns() - self._clock.monotonic_ns() - self._offset_ns) / 1e9

    @property
    def was_set(self) -> bool:
        """True when somebody set the clock, beyond what keeping it right explains."""
        return abs(self.moved_s()) > _CLOCK_STEP_S


@contextmanager
def locked_folder(folder: Path) -> Iterator[None]:
    """Create the folder and hold its lock; the system releases it when the process dies.

    Raises:
        ConfigError: the folder cannot be written, or another service has it.
    """
    lock = FileLock(folder / "lock", timeout=0)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout as error:
        raise ConfigError("data", folder, Message("folder-in-use")) from error
    except OSError as error:
        raise ConfigError("data", folder, error.strerror or str(error)) from error
    try:
        yield
    finally:
        lock.release()
