"""What a battery with a DBC told, value by value, as rows of one time axis: one row a period of its profile."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from functools import partial

import numpy as np

from app.battery.source import SpeaksDbc
from app.estimation.arrays import FloatArray
from app.sessions.reading.blocks import Block, Column, ElementArray
from app.sessions.storage.battery_columns import Holder, Samples, grid_of
from app.sessions.storage.battery_fields import IS_NEW, ages_of
from app.sessions.storage.chunks import Track
from app.sessions.storage.signals import Signals
from app.sources.dbc.assembly import UNKNOWN_AGE_S

CARRIED_US = round(UNKNOWN_AGE_S * 1e6)  # what was told longer before a range is not known in it


def in_rows(
    blocks: Iterable[Block], wanted: Mapping[str, ElementArray], signals: Signals, source: SpeaksDbc, first_us: int
) -> Iterator[Block]:
    """Yield blocks in which all wanted elements share one track; rows in which nothing is known are left out.

    Args:
        blocks: in order of time, from CARRIED_US before the range.
        wanted: fields with their elements, ascending.
        signals: of the battery.
        source: how it speaks: the period of the rows, and from what age on a value is missing.
        first_us: start of the range.
    """
    ages_s = ages_of(source)
    first_of = {name: signals.of_field(name) for name in wanted}
    holders = {name: Holder(count, ages_s.get(name)) for name, (_, count) in first_of.items()}
    next_us = first_us
    for block in blocks:
        samples: dict[str, list[Samples]] = defaultdict(list)
        for column in block.columns:
            signal = first_of[column.field][0]
            values = signal.physical(np.ascontiguousarray(column.counts))
            samples[column.field].append((column.elements, column.track.times_us, values))
        grid_us = grid_of(max(next_us, block.first_us), block.last_us, round(source.period_s * 1e6))
        next_us = max(next_us, block.last_us + 1)
        period_us = round(source.period_s * 1e6)
        rows: dict[str, FloatArray] = {}
        for name, holder in holders.items():
            if name != IS_NEW:
                values, at_us = holder.rows_and_times(samples[name], grid_us)
                rows[name] = values[:, wanted[name]]
                if name == "v" and IS_NEW in wanted:
                    rows[IS_NEW] = (at_us > grid_us[:, None] - period_us).astype(np.float64)[:, wanted[IS_NEW]]
        is_known = np.any([np.isfinite(each).any(axis=1) for name, each in rows.items() if name != IS_NEW], axis=0)
        if not is_known.any():
            continue
        track = Track(grid_us[is_known], -grid_us[is_known])
        yield Block(
            tuple(
                Column(name, wanted[name], track, partial(np.asarray, values[is_known]))
                for name, values in rows.items()
                if np.isfinite(values).any()
            )
        )
