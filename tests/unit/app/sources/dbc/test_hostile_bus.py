"""A battery on python-can's virtual bus among nodes that misbehave: no value is made up, what is missing is missing."""

import queue
import random
import uuid
from dataclasses import replace

import can
import numpy as np
import pytest

from app.clock import Clock
from app.sources.dbc.source import DbcSource
from app.sources.items import CanItem, LinkChange
from app.sources.links.can import CanLink
from app.sources.loaded_battery import load_battery
from tests.campaign import of_size

LOADED = load_battery("one-signal-a-cell")
N_CELLS = LOADED.battery.n_cells
TRUE_V = 3.5 + 0.001 * np.arange(N_CELLS)
VOLTAGES = [message for message in LOADED.definitions.messages if message.name.startswith("CellVoltages")]
KNOWN = {message.can_id for message in LOADED.definitions.messages}
END = 0x7FF
FLOOD = of_size(2_000, 20_000, 80_000, 200_000)
STEP_NS = 200_000


def true_frames() -> list[can.Message]:
    """All cells, as the battery tells them."""
    found = []
    for message in VOLTAGES:
        cells = [int(signal.name.rpartition("_")[2]) - 1 for signal in message.signals]
        raw = [round(TRUE_V[cell] / 1e-4) if cell < N_CELLS else 0 for cell in cells]
        data = b"".join(value.to_bytes(2, "little") for value in raw)
        found.append(can.Message(arbitration_id=message.can_id, is_extended_id=False, data=data))
    return found


@pytest.fixture(scope="module")
def bus():
    """A node on the bus, and what the link delivers of all that it sends."""
    channel, items = uuid.uuid4().hex, queue.Queue()
    link = CanLink(f"virtual:{channel}", items.put, Clock())
    with can.Bus(interface="virtual", channel=channel) as node:
        link.start()
        while not (isinstance(item := items.get(timeout=20), LinkChange) and item.state == "open"):
            pass

        def spoken(messages: list[can.Message]) -> list[CanItem]:
            for message in [*messages, can.Message(arbitration_id=END, is_extended_id=False)]:
                node.send(message)
            found = []
            while not (isinstance(item := items.get(timeout=20), CanItem) and item.can_id == END):
                if isinstance(item, CanItem):
                    found.append(item)
            return found

        yield spoken
        link.stop()


def voltages(items: list[CanItem]) -> np.ndarray:
    """What the source says at the end of what it received."""
    source = DbcSource(LOADED.battery, LOADED.dbc_mapping, LOADED.definitions)
    for number, item in enumerate(items, 1):
        source.feed(replace(item, t_mono_ns=10**9 + number * STEP_NS))
    now_ns = 10**9 + (len(items) + 1) * STEP_NS
    return source.measure(max(now_ns, source.due_ns or 0), 0).voltage_v


def unknown(rng: random.Random) -> can.Message:
    is_extended = rng.random() < 0.5
    can_id = rng.randrange(1 << 29) if is_extended else rng.choice([x for x in range(0x7FF) if x not in KNOWN])
    return can.Message(arbitration_id=can_id, is_extended_id=is_extended, data=rng.randbytes(rng.randrange(9)))


def short(rng: random.Random) -> can.Message:
    message = rng.choice(VOLTAGES)
    return can.Message(arbitration_id=message.can_id, is_extended_id=False, data=b"", dlc=0)


def requested(rng: random.Random) -> can.Message:
    return can.Message(arbitration_id=rng.choice(VOLTAGES).can_id, is_extended_id=False, is_remote_frame=True, dlc=8)


def error(rng: random.Random) -> can.Message:
    data = rng.randbytes(8)
    return can.Message(arbitration_id=rng.choice([0x4, 0x40, 0x8, 0x20]), is_error_frame=True, data=data)


def same_number_but_29_bits(rng: random.Random) -> can.Message:
    return can.Message(arbitration_id=rng.choice(VOLTAGES).can_id, is_extended_id=True, data=rng.randbytes(8))


def fd(rng: random.Random) -> can.Message:
    return can.Message(arbitration_id=0x123, is_extended_id=False, is_fd=True, data=rng.randbytes(64))


@pytest.mark.parametrize("other", [unknown, short, requested, error, same_number_but_29_bits, fd])
def test_what_others_send_changes_no_value_of_the_battery(bus, other):
    rng = random.Random(1)
    among = [other(rng) for _ in range(FLOOD)]
    for message in true_frames():
        among.insert(rng.randrange(FLOOD * 9 // 10, len(among)), message)
    assert voltages(bus(among)) == pytest.approx(TRUE_V, abs=1e-9)


def test_a_cut_frame_tells_the_cells_that_it_carries_whole(bus):
    for length in range(8):
        cut = [
            can.Message(arbitration_id=m.arbitration_id, is_extended_id=False, data=m.data[:length])
            for m in true_frames()
        ]
        told = voltages(bus(cut))
        carried = np.arange(N_CELLS) % 4 < length // 2
        assert told[carried] == pytest.approx(TRUE_V[carried], abs=1e-9)
        assert np.isnan(told[~carried]).all()


def test_cells_whose_message_two_nodes_send_are_missing_and_the_others_are_not(bus):
    frames = true_frames()
    doubled = frames[1]
    other = can.Message(arbitration_id=doubled.arbitration_id, is_extended_id=False, data=b"\x20\x80" * 4)  # 3.28 V
    of_message = np.arange(N_CELLS) // 4 == 1
    told = voltages(bus([message for _ in range(20) for message in (*frames, other)]))
    assert np.isnan(told[of_message]).all()
    assert told[~of_message] == pytest.approx(TRUE_V[~of_message], abs=1e-9)
