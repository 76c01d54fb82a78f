"""The simulator's errors: one root, one leaf per thing a caller handles differently."""

from __future__ import annotations


class SimulatorError(Exception):
    """Root of everything the simulator raises on purpose."""


class ParameterError(SimulatorError):
    """A physical parameter or input is outside what the model means."""

    def __init__(self, name: str, value: object, rule: str) -> None:
        self.name = name
        self.value = value
        self.rule = rule
        super().__init__(f"{name} = {value!r}: {rule}")
