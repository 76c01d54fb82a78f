"""Named commands to the master."""

from collections.abc import Callable
from typing import Any

from fastapi import APIRouter
from pydantic import BaseModel

from app.api.deps import RuntimeDep, UserDep
from app.api.problems import invalid, not_found
from app.api.schemas.service import CommandsOut, DoneOut
from firmware_protocol.messages import Command, CommandId

router = APIRouter(prefix="/commands", tags=["commands"])


class Argument(BaseModel):
    """A command's argument, where it takes one."""

    argument: float | None = None


def _none(argument: float | None) -> int:
    if argument is not None:
        raise invalid("argument", argument, "this command takes none")
    return 0


def _within(low: float, high: float, scale: float, *, automatic: int | None = None) -> Callable[[float | None], int]:
    def convert(argument: float | None) -> int:
        if argument is None and automatic is not None:
            return automatic
        if argument is None or not low <= argument <= high:
            raise invalid("argument", argument, f"between {low:g} and {high:g}")
        if scale == 1 and argument != int(argument):
            raise invalid("argument", argument, "a whole number")
        return round(argument * scale)

    return convert


COMMANDS: dict[str, tuple[CommandId, Callable[[float | None], int]]] = {
    "charge-start": (CommandId.CHARGE_START, _none),
    "charge-stop": (CommandId.CHARGE_STOP, _none),
    "balance-start": (CommandId.BALANCE_START, _none),
    "balance-stop": (CommandId.BALANCE_STOP, _none),
    "fan-override": (CommandId.FAN_OVERRIDE, _within(0, 1, 255, automatic=-1)),
    "clear-faults": (CommandId.CLEAR_FAULTS, _none),
    "set-soc": (CommandId.SET_SOC, _within(0, 1, 10000)),
    "can-tx-enable": (CommandId.CAN_TX_ENABLE, _within(0, 255, 1)),
    "can-send": (CommandId.CAN_SEND, _within(0, 7, 1)),
    "reset": (CommandId.RESET, _none),
}


@router.get("", response_model=CommandsOut)
def names() -> dict[str, Any]:
    """The commands there are."""
    return {"commands": [*COMMANDS, "stream-start", "stream-stop"]}


@router.post("/{name}", response_model=DoneOut)
def command(name: str, runtime: RuntimeDep, user: UserDep, body: Argument | None = None) -> dict[str, Any]:
    """Send a command and wait for the master's answer."""
    argument = body.argument if body else None
    if name in ("stream-start", "stream-stop"):
        _none(argument)
        runtime.operator.stream(user.name, on=name == "stream-start")
    elif name in COMMANDS:
        command_id, convert = COMMANDS[name]
        runtime.operator.command(name, Command(command_id, convert(argument)), user.name)
    else:
        raise not_found("command", name)
    return {"done": True}
