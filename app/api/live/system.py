"""The host of the service: who reads, where it is reached, disk, clock."""

from typing import Literal

from fastapi import APIRouter
from pydantic import BaseModel

from app.api.web.dependencies import CertificatePart, ClockPart, ClockWatchPart, FanOutPart, RecorderPart, SettingsPart
from app.api.web.fan_out import Reader
from app.service.host import addresses_of, disk_of

router = APIRouter(tags=["live"])
_LEAST_S = 10.0  # recording time before its rate means anything


class ReaderOut(BaseModel):
    """One open live stream."""

    name: str | None
    role: Literal["viewer", "engineer", "chief"] | None
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


class CertificateOut(BaseModel):
    """Identity of the HTTPS certificate: its SHA-256, its end in unix seconds."""

    fingerprint: str
    ends: float
    is_own: bool


class SystemOut(BaseModel):
    """The machine that the service runs on, and who reads."""

    listens_on: str
    addresses: list[str]
    certificate: CertificateOut | None
    disk: DiskOut | None
    commit_delay_s: float | None  # longest time from a frame's arrival to its commit within a minute
    clock: ClockOut
    readers: list[ReaderOut]


@router.get("/system")
def system(
    settings: SettingsPart,
    recorder: RecorderPart,
    clock: ClockPart,
    watch: ClockWatchPart,
    fan_out: FanOutPart,
    certificate: CertificatePart,
) -> SystemOut:
    """Addresses under which other machines reach the service, disk, clock, and who reads."""
    disk = disk_of(settings.data)
    return SystemOut(
        listens_on=settings.host,
        addresses=addresses_of(settings.host),
        certificate=None
        if certificate is None
        else CertificateOut(fingerprint=certificate.fingerprint, ends=certificate.ends_s, is_own=certificate.is_own),
        disk=None
        if disk is None
        else DiskOut(
            folder=str(settings.data), recording_hours_left=_hours_left(recorder, clock, disk["free_bytes"]), **disk
        ),
        commit_delay_s=recorder.status.commit_delay_s,
        clock=ClockOut(time=clock.wall_s(), moved_s=round(watch.moved_s(), 3), was_set=watch.was_set),
        readers=[_reader_out(reader) for reader in fan_out.readers],
    )


def _reader_out(reader: Reader) -> ReaderOut:
    user = reader.user
    name, role = (None, None) if user is None else (user.name, user.role)
    return ReaderOut(name=name, role=role, address=reader.address, since=reader.since_s)


def _hours_left(recorder: RecorderPart, clock: ClockPart, free_bytes: int) -> float | None:
    session = recorder.session
    if session is None:
        return None
    seconds = clock.wall_s() - session.started_wall_ns / 1e9
    if seconds < _LEAST_S or session.size_bytes <= 0:
        return None
    return round(free_bytes / (session.size_bytes / seconds) / 3600, 1)
