"""Errors of the numerics: what a caller handles differently has a class of its own.

EstimatorError
  ModelError      a cell model's numbers do not describe a cell (field, reason)
    CellFileError a cell file cannot be used (path, line, field, reason)
  ShapeError      an array does not have the shape the call needs (name, expected, received)
  DatasetError    a recording cannot be used (source, problem)
"""

from __future__ import annotations


class EstimatorError(Exception):
    """Root of everything the estimation package raises."""


class ModelError(EstimatorError):
    """A cell model is inconsistent: the field at fault and the reason."""

    def __init__(self, field: str, reason: str) -> None:
        self.field = field
        self.reason = reason
        super().__init__(f"{field}: {reason}")


class CellFileError(ModelError):
    """A cell file cannot be used: the file, the line (1-based, None if unknown), the field and the reason."""

    def __init__(self, path: str, line: int | None, field: str, reason: str) -> None:
        super().__init__(field, reason)
        self.path = path
        self.line = line
        place = path if line is None else f"{path}, line {line}"
        self.args = (f"{place}: {field}: {reason}" if field else f"{place}: {reason}",)


class ShapeError(EstimatorError):
    """An array has another shape than the call needs."""

    def __init__(self, name: str, expected: tuple[int, ...], received: tuple[int, ...]) -> None:
        self.name = name
        self.expected = expected
        self.received = received
        super().__init__(f"{name} has shape {received}, expected {expected}")


class DatasetError(EstimatorError):
    """A recording cannot be used; the message names the source, the column and what to do."""

    def __init__(self, source: str, problem: str) -> None:
        self.source = source
        self.problem = problem
        super().__init__(f"{source}: {problem}")


def check_step(dt_s: float) -> None:
    """Refuse a step length that no time can have: one such number would spoil every mean for good.

    Raises:
        EstimatorError: dt_s is negative or not finite.
    """
    if not 0.0 <= dt_s < float("inf"):
        raise EstimatorError(f"dt_s is {dt_s}: a step length is finite and not negative")
