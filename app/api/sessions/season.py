"""The season: SQL over its lake, for engineers."""

import time
from typing import Annotated, Any

from fastapi import APIRouter
from pydantic import BaseModel, Field

from app.api.web.dependencies import SeasonPart
from app.api.web.problems import invalid
from app.api.web.request_body import Body
from app.season.store.questions import Question, questions
from app.season.store.store import QueryFailed

_NO_NUL = r"^[^\x00]*$"
router = APIRouter(prefix="/season", tags=["season"])


class SeasonQuestionsOut(BaseModel):
    """The questions that come along, and where the lake lies."""

    lake: str
    questions: list[Question]


class SeasonQuery(Body):
    """One SELECT, or the name of a question."""

    question: str = Field(
        min_length=1, max_length=20_000, pattern=_NO_NUL, description="one SELECT, or the name of a question"
    )
    parameters: dict[
        Annotated[str, Field(max_length=64, pattern=r"^[A-Za-z_]\w*$")],
        Annotated[str, Field(max_length=200, pattern=_NO_NUL)],
    ] = Field({}, max_length=20, description="values of `$name`")


class SeasonAnswerOut(BaseModel):
    """Rows of an answer; times in ISO 8601, null where nothing is known."""

    columns: list[str]
    rows: list[list[Any]]
    is_cut: bool = Field(description="there are more rows than these")
    seconds: float


@router.get("/questions")
def season_questions(season: SeasonPart) -> SeasonQuestionsOut:
    """The questions that come along, with their SQL."""
    return SeasonQuestionsOut(lake=season.place, questions=[*questions()])


@router.post("/query")
def season_query(body: SeasonQuery, season: SeasonPart) -> SeasonAnswerOut:
    """Answer one SELECT over the season lake: 20 s, 512 MB and 5,000 rows at most, and nothing but the lake is read."""
    began = time.monotonic()
    try:
        answer = season.query(body.question, body.parameters)
    except QueryFailed as error:
        raise invalid("question", body.question, error.reason) from error
    return SeasonAnswerOut(**answer, seconds=round(time.monotonic() - began, 3))
