"""The season's store: a lake that answers in SQL."""

from app.season.store.store import Answer, QueryFailed, QueryLimits, SeasonError, SeasonStore

__all__ = ["Answer", "QueryFailed", "QueryLimits", "SeasonError", "SeasonStore"]
