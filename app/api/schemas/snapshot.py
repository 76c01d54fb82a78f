"""The snapshot's shape for OpenAPI and the page's types, made from the dataclasses of app.telemetry.

null = missing, never 0.
"""

from dataclasses import is_dataclass
from functools import cache
from typing import Any, Literal, Union, get_args

from pydantic import BaseModel, ConfigDict, Field, create_model

from app.estimation.prediction.energy import LapsLeft
from app.estimation.prediction.power import StatePower, TimeToTrip
from app.telemetry import Ages, BoolArray, LinkStatus, Snapshot
from app.telemetry.cell_findings import Finding
from app.telemetry.encoding import alternatives, element_of, is_array
from app.telemetry.fields import Described, SentAs, Unit, described
from app.telemetry.service_state import Replay, ServiceState
from app.words import RenderedMessage

Number = float | None
PerCell = list[float | None]
Severity = Literal["info", "watch", "warning", "trip"]
_NAMES = {
    Finding: "CellFinding",
    Ages: "Age",
    LinkStatus: "Link",
    StatePower: "Power",
    TimeToTrip: "Trip",
    LapsLeft: "Laps",
}
_INFINITE = {(TimeToTrip, name) for name in ("seconds", "low_s", "high_s")}  # not within an hour: null in JSON


@cache
def model_of(owner: type) -> type[BaseModel]:
    """Return the model of what is sent of a dataclass, named after it."""
    return _model(_NAMES.get(owner, owner.__name__), owner)


def _model(name: str, *owners: type) -> type[BaseModel]:
    """Return one model of all fields, with the first line of the first docstring."""
    fields: dict[str, Any] = {
        field.json_name: (_type(owner, field) | None if field.may_be_left_out else _type(owner, field), _info(field))
        for owner in owners
        for field in described(owner)
        if not field.is_internal
    }
    config, meaning = ConfigDict(from_attributes=True), (owners[0].__doc__ or "").partition("\n")[0]
    return create_model(f"{name}Out", __doc__=meaning, __config__=config, __module__=__name__, **fields)


def _info(field: Described) -> Any:
    unit: Unit | None = field.mark(Unit)
    default: dict[str, Any] = {"default": None} if field.may_be_left_out else {}
    if unit is None:
        return Field(**default)
    return Field(description=unit.meaning, json_schema_extra={"unit": unit.unit}, **default)


def _type(owner: type, field: Described) -> Any:
    sent: SentAs | None = field.mark(SentAs)
    if sent is not None and sent.divisor is not None:
        return float | None if alternatives(field.type) != (field.type,) else float
    members = alternatives(field.type)
    if field.is_message:
        return RenderedMessage | None if type(None) in get_args(field.type) else RenderedMessage
    if is_array(members[0]):
        return list[bool | None] if members[0] == BoolArray else PerCell
    kinds = tuple(_sent_type(member) for member in members)
    may_miss = members != (field.type,) or (owner, field.name) in _INFINITE
    return Union[(*kinds, None)] if may_miss else kinds[0]


def _sent_type(kind: Any) -> Any:
    element = element_of(kind)
    if element is not None:
        return list[_sent_type(element)]  # type: ignore[misc]
    return model_of(kind) if is_dataclass(kind) else kind  # type: ignore[arg-type]


ReplayOut = model_of(Replay)
SnapshotOut = _model("Snapshot", Snapshot, ServiceState)
