"""Any dataclass of this folder as JSON: names, decimals and what is sent are read from its fields, once for each class.

Missing values (None, NaN, infinity) become null. What needs no change is left to orjson, which reads dataclasses.
"""

from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass, replace
from functools import cache
from operator import attrgetter
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin

import numpy as np
import orjson
from numpy.typing import NDArray

from app.telemetry.events import LinkStatus
from app.telemetry.fields import Described, SentAs, Unit, described
from app.telemetry.measurement import STALE_S
from app.telemetry.snapshot import Ages, Number, Snapshot
from app.words import rendered

Packs = Sequence[int]
_Convert = Callable[[Any, Packs], Any]


def encode(body: object) -> bytes:
    """Return the JSON of what `plain` returned, or of any dict, list, dataclass and array."""
    return orjson.dumps(body, option=orjson.OPT_SERIALIZE_NUMPY)


def plain(value: Any, segments: Packs = ()) -> Any:
    """Return a dataclass as what orjson can write: a dict with the names, decimals and units of JSON.

    `segments` are the cells of each pack of its battery: its messages name cells by them.
    """
    owner: type = type(value)
    convert = _converter(owner)
    return value if convert is None else convert(value, segments)


def alternatives(hint: Any) -> tuple[Any, ...]:
    """Return the types that a field may have, without None."""
    members = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    return tuple(member for member in members if member is not NoneType)


def element_of(hint: Any) -> Any:
    """Return T of tuple[T, ...], None for any other type."""
    arguments = get_args(hint)
    return arguments[0] if get_origin(hint) is tuple and len(arguments) == 2 and arguments[1] is ... else None


def is_array(hint: Any) -> bool:
    """The type is a numpy array, also by NDArray, which is an alias of its own from numpy 2.5 on."""
    return get_origin(hint) in (np.ndarray, NDArray)


@cache
def _converter(owner: type) -> _Convert | None:
    """Return how a class becomes a dict; None where orjson writes the same."""
    sent = [field for field in described(owner) if not field.is_internal]
    converters = [_field_converter(field) for field in sent]
    names = [field.json_name for field in sent]
    if not any(converters) and names == [field.name for field in described(owner)]:
        return None
    read = attrgetter(*(field.name for field in sent))
    plan = list(zip(names, converters, strict=True))
    left_out = [field.json_name for field in sent if field.may_be_left_out]
    arrays = [field.json_name for field in sent if any(is_array(member) for member in alternatives(field.type))]

    def convert(value: Any, segments: Packs) -> dict[str, Any]:
        values = zip(plan, read(value), strict=True)
        body = {name: value if change is None else change(value, segments) for (name, change), value in values}
        for name in left_out:
            if body[name] is None:
                del body[name]
        for name in arrays:
            if name in body and body[name] is None:
                body[name] = [None] * len(body[arrays[0]])
        return body

    return convert


def _field_converter(field: Described) -> _Convert | None:
    sent: SentAs | None = field.mark(SentAs)
    unit: Unit | None = field.mark(Unit)
    if field.is_message:
        return lambda message, segments: None if message is None else rendered(message, segments)
    (kind, *others) = alternatives(field.type)
    if sent is not None and sent.divisor is not None:
        divisor = sent.divisor
        return lambda value, _: None if value is None else value / divisor
    if unit is not None and unit.decimals is not None and kind is not int:
        return _rounding(unit.decimals, of_array=is_array(kind))
    if others:
        return None
    element = element_of(kind)
    if element is not None and is_dataclass(element):
        convert_element = _converter(element)  # type: ignore[arg-type]
        if convert_element is None:
            return None
        return lambda values, segments: (
            None if values is None else [convert_element(value, segments) for value in values]
        )
    if is_dataclass(kind):
        whole = _converter(kind)  # type: ignore[arg-type]
        return None if whole is None else lambda value, segments: None if value is None else whole(value, segments)
    return None


def _rounding(decimals: int, *, of_array: bool) -> _Convert:
    if of_array:
        return lambda values, _: None if values is None else np.round(values, decimals)
    return lambda value, _: round(value, decimals) if isinstance(value, float) else value


def is_stale(snapshot: Snapshot, part: str) -> bool:
    """A part is older than it may be to count as live, or was never received."""
    age_s: Number = getattr(snapshot.age_s, part)
    live_s: Number = None if snapshot.live_s is None else getattr(snapshot.live_s, part)
    return age_s is None or age_s >= (STALE_S if live_s is None else live_s)


def aged(snapshot: Snapshot, now_ns: int) -> Snapshot:
    """Return a snapshot with its ages at an instant of the monotonic clock.

    A replay's ages are those of then.
    """
    waited_s = (now_ns - snapshot.t_mono_ns) / 1e9
    if snapshot.source == "replay" or waited_s <= 0.0:
        return snapshot

    def older(age_s: Number) -> Number:
        return None if age_s is None else age_s + waited_s

    def link(status: LinkStatus) -> LinkStatus:
        return replace(status, age_s=older(status.age_s))

    ages = Ages(*(older(getattr(snapshot.age_s, field.name)) for field in fields(Ages)))
    links = replace(snapshot.links, rs232=link(snapshot.links.rs232), can=link(snapshot.links.can))
    cells = snapshot.cells
    if cells.voltage_age_s is not None:
        cells = replace(cells, voltage_age_s=cells.voltage_age_s + waited_s)
    return replace(snapshot, age_s=ages, links=links, cells=cells)
