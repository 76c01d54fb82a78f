"""What a job may use of the machine."""

import os
from dataclasses import dataclass
from functools import cache

MB = 1 << 20
MEMORY_BYTES = 2048 * MB  # or half of the machine's
LEAST_BYTES = 384 * MB


@dataclass(frozen=True, slots=True)
class Limits:
    """Processor time [s], and memory beside what the program itself takes [bytes]; None: what `memory_limit` says."""

    cpu_s: int
    memory_bytes: int | None = None

    @property
    def wall_s(self) -> float:
        """How long it may take on a machine that does much else [s]."""
        return 60.0 + 6.0 * self.cpu_s


DEFINITIONS = Limits(30)  # a DBC, a battery's profile
INSPECTION = Limits(120)  # the table in a file
REPORT = Limits(180)
EXPORT = Limits(600)
_IMPORT_S, _IMPORT_S_PER_MB = 120, 20


def import_limits(size_bytes: int) -> Limits:
    """Return what the import of a file may use, by its size."""
    return Limits(_IMPORT_S + _IMPORT_S_PER_MB * (size_bytes // MB))


@cache
def memory_limit() -> int:
    """Return what a job may take on this machine [bytes]: half of its memory, at most 2 GB."""
    try:
        physical = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):  # Windows
        return MEMORY_BYTES
    return max(LEAST_BYTES, min(MEMORY_BYTES, physical // 2))
