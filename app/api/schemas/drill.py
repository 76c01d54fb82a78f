"""A drill on the simulated car, as it is sent."""

from pydantic import BaseModel

from app.analysis.drill.days import CHOICES
from app.analysis.drill.drill import DrillState, Result
from app.analysis.drill.score import Answer
from app.api.encoding.words import messages_json
from app.api.schemas.snapshot import Number
from app.api.schemas.words import WordsOut


class DrillAnswerOut(BaseModel):
    """What somebody said failed; pack and cell as people count them."""

    fault: str
    pack: int | None
    cell: int | None


class DrillDayOut(BaseModel):
    """A day that was answered; times in seconds since the fault began."""

    number: int
    fault: str
    pack: int | None
    cell: int | None
    value: Number
    answer: DrillAnswerOut
    points: int
    most: int
    taken_s: float
    visible_s: Number
    said: list[str]
    said_words: list[WordsOut | None]
    product: DrillAnswerOut | None
    product_points: int


class DrillOut(BaseModel):
    """A drill as it stands; `choices` are the faults that a day may have."""

    is_on: bool
    seed: int | None
    day: int
    days: int
    points: int
    most: int
    choices: list[str]
    results: list[DrillDayOut]


def drill_out(state: DrillState) -> DrillOut:
    """Return what is sent of a drill."""
    return DrillOut(
        is_on=state.is_on,
        seed=None if state.is_on else state.seed,  # who knows the seed knows the days
        day=state.day,
        days=state.days,
        points=state.points,
        most=state.most,
        choices=list(CHOICES),
        results=[_day(each) for each in state.results],
    )


def _day(result: Result) -> DrillDayOut:
    day = result.day
    return DrillDayOut.model_validate(
        {
            "number": day.number,
            "fault": day.fault,
            "pack": day.pack,
            "cell": day.cell,
            "value": day.value,
            "answer": _answer(result.answer),
            "points": result.points,
            "most": result.most,
            "taken_s": result.taken_s,
            "visible_s": result.visible_s,
            **messages_json("said", result.said),
            "product": None if result.product is None else _answer(result.product),
            "product_points": result.product_points,
        }
    )


def _answer(answer: Answer) -> DrillAnswerOut:
    return DrillAnswerOut(fault=answer.fault, pack=answer.pack, cell=answer.cell)
