"""Named commands to the master, and the guided calibration of its current sensor."""

from collections.abc import Callable
from typing import Any, Literal

from fastapi import APIRouter
from pydantic import Field

from app.api.schemas.service import CalibrationOut, CommandsOut, DoneOut
from app.api.web.dependencies import (
    CommandsPart,
    ConfigurationPart,
    EventsPart,
    LinksPart,
    LivePart,
    SettingsPart,
    UserDep,
)
from app.api.web.problems import Problem, invalid, not_found
from app.api.web.request_body import Body
from app.battery.shape import CELLS_PER_PACK, N_CELLS
from app.configuration.calibration import measure, propose_gain, propose_zero
from app.configuration.command_conditions import BALANCING, block_reasons
from app.errors import MasterRefused
from app.service.master import MasterCommands
from app.telemetry import Identity
from app.words import Message, Quantity, rendered
from firmware_protocol.messages import MAX_FAN_OVERRIDE_S, Command, CommandId

router = APIRouter(tags=["commands"])
STREAM = ("stream-start", "stream-stop")


class Argument(Body):
    """A command's argument, where it takes one."""

    argument: float | None = None
    duration_s: int | None = Field(
        default=None, ge=1, le=MAX_FAN_OVERRIDE_S, description="fan-override: then automatic again"
    )
    cells: list[int] | None = Field(default=None, max_length=N_CELLS, description="balance-cells: indices 0..95")


def _none(argument: float | None) -> int:
    if argument is not None:
        raise invalid("argument", argument, Message("takes-none"))
    return 0


def _within(low: float, high: float, scale: float, *, automatic: int | None = None) -> Callable[[float | None], int]:
    def convert(argument: float | None) -> int:
        if argument is None and automatic is not None:
            return automatic
        if argument is None or not low <= argument <= high:
            raise invalid("argument", argument, Message("between", low=low, high=high))
        if scale == 1 and argument != int(argument):
            raise invalid("argument", argument, Message("a-whole-number"))
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
    "soc-from-ocv": (CommandId.SOC_FROM_OCV, _none),
    "can-tx-enable": (CommandId.CAN_TX_ENABLE, _within(0, 255, 1)),
    "can-send": (CommandId.CAN_SEND, _within(0, 7, 1)),
    "reset": (CommandId.RESET, _none),
}


@router.get("/commands", response_model=CommandsOut)
def names(live: LivePart, settings: SettingsPart) -> dict[str, Any]:
    """The commands there are, and why some would be refused now, by this service or by the master."""
    reasons = _block_reasons(live, settings)
    return {
        "commands": [*COMMANDS, "balance-cells", *STREAM],
        "block_reasons": {name: rendered(why) for name, why in reasons.items()},
    }


@router.post("/commands/{name}", response_model=DoneOut)
def command(
    name: str,
    commands: CommandsPart,
    live: LivePart,
    settings: SettingsPart,
    user: UserDep,
    body: Argument | None = None,
) -> dict[str, Any]:
    """Send a command and wait for the master's answer."""
    asked = body or Argument()
    if asked.duration_s is not None and (name != "fan-override" or asked.argument is None):
        raise invalid("duration_s", asked.duration_s, Message("only-with-fan-duty"))
    if asked.cells is not None and name != "balance-cells":
        raise invalid("cells", len(asked.cells), Message("only-with-balance-cells"))
    if name in BALANCING and (reason := _balancing_block_reason(live, settings)) is not None:
        raise Problem(409, "rules", reason)
    try:
        _send(name, asked, commands, user.name)
    except MasterRefused as error:
        why = _block_reasons(live, settings).get(name)
        if error.result != "NOT_NOW" or why is None:
            raise
        raise Problem(409, "refused", Message("blocked-now", why=why), result=error.result) from error
    return {"done": True}


def _send(name: str, asked: Argument, commands: MasterCommands, who: str) -> None:
    if name in STREAM:
        _none(asked.argument)
        commands.stream(who, on=name == "stream-start")
    elif name == "balance-cells":
        _none(asked.argument)
        _balance(commands, asked.cells or [], who)
    elif name in COMMANDS:
        command_id, convert = COMMANDS[name]
        argument = convert(asked.argument) | (asked.duration_s or 0) << 8
        commands.send(name, Command(command_id, argument), who, _in_words(asked))
    else:
        raise not_found("command", name)


def _in_words(asked: Argument) -> str:
    duration = f" for {asked.duration_s} s" if asked.duration_s else ""
    return "" if asked.argument is None else f"{asked.argument:g}{duration}"


def _block_reasons(live: LivePart, settings: SettingsPart) -> dict[str, Message]:
    rules = _balancing_block_reason(live, settings)
    return ({} if rules is None else dict.fromkeys(BALANCING, rules)) | block_reasons(live.snapshot)


def _balancing_block_reason(live: LivePart, settings: SettingsPart) -> Message | None:
    """Why the competition's rules forbid balancing now: the relays are open, or not known to be closed."""
    snapshot = live.snapshot
    flags = None if snapshot is None else snapshot.master.flags
    if settings.balance_open or (flags is not None and flags.load):
        return None
    return Message("no-balancing-open")


def _balance(commands: CommandsPart, cells: list[int], who: str) -> None:
    """Bleed exactly these cells: what was chosen before ends, then each pack gets its own."""
    if not cells:
        raise invalid("cells", Message("none"), Message("at-least-one-cell"))
    for cell in cells:
        if not 0 <= cell < N_CELLS:
            raise invalid("cells", cell, f"0..{N_CELLS - 1}")
    commands.send("balance-stop", Command(CommandId.BALANCE_STOP), who)
    for pack in sorted({cell // CELLS_PER_PACK for cell in cells}):
        positions = sorted({cell % CELLS_PER_PACK for cell in cells if cell // CELLS_PER_PACK == pack})
        mask = sum(1 << position for position in positions)
        details = f"pack {pack + 1}, cells {', '.join(str(position + 1) for position in positions)}"
        request = Command(CommandId.BALANCE_CELLS, pack << CELLS_PER_PACK | mask)
        commands.send("balance-cells", request, who, details)


@router.post("/identify")
def identify(events: EventsPart, links: LinksPart, user: UserDep) -> Identity:
    """Ask the master who it is, now."""
    identity = links.master.identify()
    events.note("info", "command", Message("identified", firmware=identity.firmware, boots=identity.boots), user.name)
    return identity


class CalibrationIn(Body):
    """A calibration: of the zero with relays open, or of the gain against a reference meter."""

    what: Literal["measure", "zero", "gain"]
    reference_a: float | None = Field(None, ge=-1000, le=1000, description="gain: the meter, positive on discharge")


@router.post("/calibration/current")
def calibrate(
    body: CalibrationIn, events: EventsPart, links: LinksPart, configuration: ConfigurationPart, user: UserDep
) -> CalibrationOut:
    """Average the current over a second, and propose the offset or gain that corrects it. Nothing is written."""
    if body.what == "gain" and body.reference_a is None:
        raise invalid("reference_a", None, Message("reference-current"))
    image = configuration.read()
    measured = measure(links.master)
    proposal = None
    if body.what == "zero":
        proposal = propose_zero(image, measured)
    elif body.what == "gain" and body.reference_a is not None:
        proposal = propose_gain(image, measured, body.reference_a)
    current, sigma = Quantity(measured.mean_a, "A", 2), Quantity(measured.sigma_a, "A", 2)
    message = Message("current-measured", what=body.what, current=current, sigma=sigma)
    if proposal is not None:
        change = f"{proposal.field} {proposal.before_raw} -> {proposal.after_raw}"
        message = Message("current-proposed", what=body.what, current=current, sigma=sigma, change=change)
    events.note("info", "calibration", message, user.name)
    return CalibrationOut(measured=measured, proposal=proposal)
