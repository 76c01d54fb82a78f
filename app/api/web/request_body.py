"""What request bodies have in common."""

from pydantic import BaseModel, ConfigDict


class Body(BaseModel):
    """A request's body: a member that is not known, or true where a number belongs, is an error and not a guess."""

    model_config = ConfigDict(extra="forbid", strict=True)
