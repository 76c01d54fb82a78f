"""The season's store: a lake that answers in SQL."""

from app.season.store.store import Answer, Limits, QueryFailed, SeasonError, SeasonStore

__all__ = ["Answer", "Limits", "QueryFailed", "SeasonError", "SeasonStore"]
