"""What request bodies have in common."""

from typing import Annotated

from fastapi import Depends, Request
from pydantic import BaseModel, ConfigDict


class Body(BaseModel):
    """A request's body: a member that is not known, or true where a number belongs, is an error and not a guess."""

    model_config = ConfigDict(extra="forbid", strict=True)


async def _raw_body(request: Request) -> bytes:
    return await request.body()


RawBody = Annotated[bytes, Depends(_raw_body)]
