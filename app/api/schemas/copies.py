"""Copies of sessions over a bad link."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field

from app.api.schemas.snapshot import Number
from app.api.schemas.words import WordsOut


class RecorderFollowedOut(BaseModel):
    """A recorder whose sessions are copied; `heard_s` is the unix time of its last answer."""

    url: str
    is_reached: bool
    error: str | None
    error_words: WordsOut | None
    heard_s: Number


class CopyOut(BaseModel):
    """A session that is not all here; `missing` are stretches of unix time, of `pieces` pieces of `piece_s` each."""

    id: str
    name: str
    started: float
    recording: bool
    piece_s: float
    pieces: int
    missing: list[tuple[float, float]]
    missing_s: float


class CopiesOut(BaseModel):
    """Newest first; what is all here is a session as any other. `order`: which missing pieces come first."""

    order: Literal["oldest", "newest"]
    recorders: list[RecorderFollowedOut]
    copies: list[CopyOut]


class OfferOut(BaseModel):
    """A session, and how many pieces of ten seconds of it are on the disk."""

    id: str
    started: float
    bytes: int
    recording: bool
    pieces: int


class OffersOut(BaseModel):
    """Newest first."""

    sessions: list[OfferOut]


class HeadOut(BaseModel):
    """A session without its rows; `battery_files` are names and base64, empty for the team's own battery."""

    id: str
    name: str
    voltwall: str
    map_hash: str
    metadata: dict[str, Any]
    start_mono_ns: int
    start_wall_ns: int
    end_mono_ns: int | None
    end_wall_ns: int | None
    closed: bool
    recording: bool
    pieces: int
    bytes: int
    frames: int
    can_frames: int
    cell_file: str | None
    battery_files: list[Annotated[list[str], Field(min_length=2, max_length=2)]]
