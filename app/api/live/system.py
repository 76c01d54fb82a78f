"""What surrounds the service: who reads, where it is reached, disk, clock."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal

from fastapi import APIRouter, Request
from pydantic import BaseModel

from app.api.web.authentication import User
from app.api.web.dependencies import RuntimeDep
from app.service.host import ClockWatch, addresses_of, disk_of

router = APIRouter(tags=["live"])
_LEAST_S = 10.0  # of recording, before its rate says anything


class Readers:
    """Who has the live stream open. Used on the event loop alone."""

    def __init__(self) -> None:
        self._open: dict[object, tuple[User | None, str, float]] = {}

    @contextmanager
    def joined(self, user: User | None, address: str) -> Iterator[None]:
        """Count a reader for the length of a with-block."""
        key = object()
        self._open[key] = (user, address, time.time())
        try:
            yield
        finally:
            del self._open[key]

    def everyone(self) -> "list[ReaderOut]":
        """Return the readers, longest first."""
        return [
            ReaderOut(name=user.name if user else None, role=user.role if user else None, address=address, since=since)
            for user, address, since in self._open.values()
        ]


class ReaderOut(BaseModel):
    """One open live stream."""

    name: str | None
    role: Literal["engineer", "viewer"] | None
    address: str
    since: float


class DiskOut(BaseModel):
    """The disk that the sessions are on; hours at the rate of the recording in progress."""

    folder: str
    free_bytes: int
    total_bytes: int
    recording_hours_left: float | None


class ClockOut(BaseModel):
    """The service's wall clock: unix seconds, and how far it was set since the start."""

    time: float
    moved_s: float
    was_set: bool


class SystemOut(BaseModel):
    """The service's surroundings."""

    listens_on: str
    addresses: list[str]
    disk: DiskOut | None
    clock: ClockOut
    readers: list[ReaderOut]


@router.get("/system")
def system(request: Request, runtime: RuntimeDep) -> SystemOut:
    """Addresses under which other machines reach the service, disk, clock, and who reads."""
    watch: ClockWatch = request.app.state.clock
    readers: Readers = request.app.state.readers
    settings = runtime.settings
    disk = disk_of(settings.data)
    return SystemOut(
        listens_on=settings.host,
        addresses=addresses_of(settings.host),
        disk=None
        if disk is None
        else DiskOut(folder=str(settings.data), recording_hours_left=_hours_left(runtime, disk["free_bytes"]), **disk),
        clock=ClockOut(time=time.time(), moved_s=round(watch.moved_s(), 3), was_set=watch.was_set),
        readers=readers.everyone(),
    )


def _hours_left(runtime: RuntimeDep, free_bytes: int) -> float | None:
    session = runtime.recorder.session
    if session is None:
        return None
    seconds = time.time() - session.started_wall_ns / 1e9
    if seconds < _LEAST_S or session.size_bytes <= 0:
        return None
    return round(free_bytes / (session.size_bytes / seconds) / 3600, 1)
