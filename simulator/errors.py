"""The errors of the simulator.

SimulatorError
  ParameterError   a physical parameter or input is outside what the model means
  ScenarioError    a scenario that cannot be read or makes no sense
  FaultError       a fault that does not exist or cannot take this value
  InputError       a key of a file or a request that is missing, foreign, or has a value that it cannot have
  PortError        a port that cannot be opened
  FirmwareError    the master's firmware has not been built for this machine
"""


class SimulatorError(Exception):
    """Root of all errors that the simulator raises."""


class ParameterError(SimulatorError):
    """A physical parameter or input is outside the range of the model."""

    def __init__(self, name: str, value: object, rule: str) -> None:
        self.name = name
        self.value = value
        self.rule = rule
        super().__init__(f"{name} = {value!r}: {rule}")


class ScenarioError(SimulatorError):
    """A scenario that cannot be read or makes no sense; `where` names the file and the key."""

    def __init__(self, where: str, reason: str) -> None:
        self.where = where
        self.reason = reason
        super().__init__(f"{where}: {reason}")


class FaultError(SimulatorError):
    """An unknown fault, or a value that the fault does not allow."""

    def __init__(self, fault: str, reason: str) -> None:
        self.fault = fault
        self.reason = reason
        super().__init__(f"fault {fault!r}: {reason}")


class InputError(SimulatorError):
    """A key of a file or a request that is missing, unknown, or has a value that is not allowed."""

    def __init__(self, key: str, reason: str) -> None:
        self.key = key
        self.reason = reason
        super().__init__(reason)


class PortError(SimulatorError):
    """A port that cannot be opened."""

    def __init__(self, port: str, reason: str) -> None:
        self.port = port
        self.reason = reason
        super().__init__(f"{port}: {reason}")


class FirmwareError(SimulatorError):
    """The master's firmware cannot be loaded."""
