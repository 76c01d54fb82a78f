"""A shape that is too small: values that overwrite each other within a round, messages alike that are not read."""

from collections import defaultdict
from collections.abc import Iterator

import numpy as np

from app.estimation.arrays import FloatArray, IntArray
from app.sources.dbc.battery_decoder import BatteryDecoder, ChannelValues
from app.sources.dbc.decoder import by_message
from app.sources.dbc.definitions import Definitions, MessageDefinition
from app.sources.dbc.frames import Frames
from app.words import Message, Text

_KINDS = ("voltage", "temperature")
_AT_ONCE = 0.25  # share of a channel's mean interval: values closer than this are of one round
_LEAST_ROUNDS = 5
_APART = {"voltage": 5e-4, "temperature": 0.05}  # V, degC by which the values of a round differ, at least
_SURE = 4.0  # standard errors
_NAMED = 6  # messages


def overwritten_issues(
    decoder: BatteryDecoder, frames: Frames, values: dict[str, ChannelValues], definitions: Definitions
) -> Iterator[tuple[str, Text]]:
    """Yield field and text of kinds whose channels get several values a round, or not all there are."""
    for kind in _KINDS:
        if kind not in values:
            continue
        messages = _of_two_messages(decoder, frames, kind)
        if messages:
            names = tuple(messages[:_NAMED])
            what = Message("check-two-messages", kind=kind, n=len(messages), names=names, part="{pack}")
            yield f"source.{kind}", what
        else:
            size = decoder.lanes.sizes[kind]
            a_round = _values_a_round(values[kind], size, _APART[kind])
            if a_round > 1:
                yield f"source.{kind}", Message("check-overwritten", kind=kind, n=a_round, size=size)
        alike = _not_read(decoder, frames, kind, definitions)
        if alike:
            what = Message("check-not-read", kind=kind, n=len(alike), names=tuple(alike[:_NAMED]))
            yield f"source.{kind}", what


def _of_two_messages(decoder: BatteryDecoder, frames: Frames, kind: str) -> list[str]:
    """Names of messages that carry channels which others carry, too, where the frames number them."""
    lanes = decoder.lanes
    numbered = {
        can_id: lanes.messages[can_id]
        for can_id, bindings in lanes.by_id.items()
        if any(binding.kind == kind and binding.numbers for binding in bindings)
    }
    by_channel: dict[int, set[str]] = defaultdict(set)
    alone = BatteryDecoder(decoder.battery, decoder.source, Definitions(tuple(numbered.values())))
    for _, group in by_message(frames, numbered):
        read = alone.decode(group.frames).get(kind)
        for channel in () if read is None else np.unique(read.index[np.isfinite(read.value)]).tolist():
            by_channel[channel].add(group.message.name)
    return sorted({name for names in by_channel.values() if len(names) > 1 for name in names})


def _values_a_round(values: ChannelValues, size: int, apart: float) -> int:
    """How many different values most channels of a kind get a round; 1 where values follow binding other in time."""
    is_measured = np.isfinite(values.value)
    index, t_ns, value = values.index[is_measured], values.t_ns[is_measured], values.value[is_measured]
    order = np.lexsort((t_ns, index))
    index, t_ns, value = index[order], t_ns[order], value[order]
    counts = np.bincount(index, minlength=size)
    if not len(index) or int(counts.max()) < 2 * _LEAST_ROUNDS:
        return 1
    ends = np.cumsum(counts) - 1
    span_ns = np.where(counts > 1, t_ns[ends] - t_ns[np.minimum(ends - counts + 1, len(t_ns) - 1)], 0)
    usual_ns = span_ns / np.maximum(counts - 1, 1)
    is_near = (index[1:] == index[:-1]) & (np.diff(t_ns) < _AT_ONCE * usual_ns[index[1:]])
    starts = np.flatnonzero(np.concatenate([[True], ~is_near]))
    sizes = np.diff(np.append(starts, len(index)))
    usual = int(np.median(sizes))
    if usual < 2:
        return 1
    whole = starts[sizes == usual]
    rounds = value[whole[:, None] + np.arange(usual)]
    return usual if _differ(index[whole], rounds, apart) else 1


def _differ(channel: IntArray, rounds: FloatArray, apart: float) -> bool:
    """Whether the values of a round differ by their place in it, again and again, in any channel."""
    from_mean = rounds - rounds.mean(axis=1, keepdims=True)
    for one in np.unique(channel).tolist():
        of_one = from_mean[channel == one]
        if len(of_one) < _LEAST_ROUNDS:
            continue
        error = float(of_one.std(axis=0).max()) / np.sqrt(len(of_one))
        if float(np.ptp(of_one.mean(axis=0))) > max(apart, _SURE * error):
            return True
    return False


def _not_read(decoder: BatteryDecoder, frames: Frames, kind: str, definitions: Definitions) -> list[str]:
    """Names of received messages with the same signals as one that is read, of which the profile reads none."""
    lanes = decoder.lanes
    read = {
        _signals(lanes.messages[can_id])
        for can_id, bindings in lanes.by_id.items()
        if any(binding.kind == kind for binding in bindings)
    }
    received = set(np.unique(frames.can_id).tolist())
    return [
        message.name
        for can_id, message in sorted(definitions.by_id().items())
        if can_id in received and can_id not in lanes.by_id and _signals(message) in read
    ]


def _signals(message: MessageDefinition) -> tuple[object, ...]:
    return tuple((signal.name, signal.layout, signal.conditions) for signal in message.signals)
