"""A process of its own for what works on files from elsewhere: limits on memory and time, low priority."""

from app.sessions.worker.limits import DEFINITIONS, EXPORT, INSPECTION, REPORT, Limits, import_limits
from app.sessions.worker.workers import Workers

__all__ = ["DEFINITIONS", "EXPORT", "INSPECTION", "REPORT", "Limits", "Workers", "import_limits"]
