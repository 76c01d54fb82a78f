"""A process of its own for what works on files from elsewhere: limits on memory and time, low priority."""

from app.sessions.worker.workers import (
    DAY,
    DEFINITIONS,
    EXPORT,
    INSPECTION,
    REPORT,
    JobLimits,
    Workers,
    command_of,
    import_limits,
)

__all__ = [
    "DAY",
    "DEFINITIONS",
    "EXPORT",
    "INSPECTION",
    "REPORT",
    "JobLimits",
    "Workers",
    "command_of",
    "import_limits",
]
