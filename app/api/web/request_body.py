"""The common part of request bodies."""

from typing import Annotated, Any

from fastapi import Depends, Request
from pydantic import BaseModel, ConfigDict, Field, model_validator

from app.api.web.middleware import MAX_BODY_BYTES


class Body(BaseModel):
    """A request's body: a member that is not known, or true where a number belongs, is an error and not a guess."""

    model_config = ConfigDict(extra="forbid", strict=True)

    @model_validator(mode="before")
    @classmethod
    def _count_members(cls, value: Any) -> Any:
        """Refuse many unknown members at once: each would be an error of its own."""
        most = len(cls.model_fields) + MOST_UNKNOWN
        if isinstance(value, dict) and len(value) > most:
            raise ValueError(f"an object of {len(value)} members; at most {most} are looked at")
        return value


MOST_UNKNOWN = 20  # members of an object
FileText = Annotated[str, Field(max_length=MAX_BODY_BYTES)]  # a limit has half a surrogate pair refused, too


async def _raw_body(request: Request) -> bytes:
    return await request.body()


RawBody = Annotated[bytes, Depends(_raw_body)]
