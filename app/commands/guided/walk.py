"""The walk through the faults: wait for a healthy master, make the fault, see the circuit open, mend, clear."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from app.analysis.evidence.evidence import MARKER
from app.analysis.evidence.steps import STEPS
from app.analysis.evidence.timing import Limits
from app.commands.guided.benches import Bench, Skipped
from app.commands.guided.station import Station
from app.errors import AppError, MasterRefused, MasterSilent
from app.words import Message
from firmware_protocol.memory_map import CONFIG
from firmware_protocol.messages import Command, CommandId, Write

READY_S: Final = 20.0  # for a master to speak, and to be healthy again
OPENS_S: Final = 6.0  # within which a fault has to open the circuit
LEAD_S, SETTLE_S, AFTER_S = 3.0, 1.0, 0.5
TEST_INTERVAL_MS: Final = 40  # the quickest telemetry that the line carries


class NotReady(AppError):
    """The master does not get to where the test can begin or go on."""


def walk(station: Station, bench: Bench, names: set[str], say: Callable[[str], None]) -> None:
    """Do the steps of these names; each is marked in the session.

    Raises:
        NotReady: no telemetry, or the circuit is open before the first step.
        LinkLost, MasterSilent, MasterRefused: the port cannot be opened, the master does not answer, or refuses.
    """
    if not station.wait_for_telemetry(READY_S):
        raise NotReady(Message("evidence-no-telemetry"))
    station.client.identify()
    image = station.read_config()
    limits = Limits.of(image)
    with _quick_telemetry(station, image, say):
        station.rest(LEAD_S)
        for number, step in enumerate(STEPS, 1):
            if step.name not in names:
                continue
            say(f"[{number}/{len(STEPS)}] {step.name} ({step.rule})")
            if not station.wait(lambda values, _: values.is_ok, READY_S):
                station.mark(MARKER, f"{step.name} skipped the shutdown circuit was open")
                say("  not tested: the shutdown circuit is open")
                continue
            station.forget_trips()
            station.rest(SETTLE_S)
            station.mark(MARKER, f"{step.name} armed")
            station.rest(AFTER_S)
            try:
                bench.fail(step, limits)
            except Skipped as reason:
                station.mark(MARKER, f"{step.name} skipped {reason}")
                continue
            opened = station.wait(lambda values, trips: not values.is_ok or bool(trips), OPENS_S)
            station.rest(AFTER_S)
            station.mark(MARKER, f"{step.name} done")
            say("  the circuit opened" if opened else f"  the circuit did not open within {OPENS_S:g} s")
            bench.mend(step)
            _clear(station)
        station.rest(SETTLE_S)


def _clear(station: Station) -> None:
    """Clear faults as soon as the master takes it: it refuses while the cause lasts, and may have a button instead."""
    tries = round(READY_S / SETTLE_S)
    for _ in range(tries):
        try:
            station.client.request(Command(CommandId.CLEAR_FAULTS, 0))
        except (MasterRefused, MasterSilent):
            station.rest(SETTLE_S)
            continue
        if station.wait(lambda values, _: values.is_ok, SETTLE_S):
            return


@contextmanager
def _quick_telemetry(station: Station, image: bytes, say: Callable[[str], None]) -> Iterator[None]:
    """Set the telemetry to its quickest, and back: only in force, never stored."""
    period = CONFIG["telemetry_period"]
    own_ms = period.unpack(image)[0]
    if own_ms <= TEST_INTERVAL_MS:
        yield
        return
    try:
        station.client.request(Write(period.offset, TEST_INTERVAL_MS.to_bytes(period.size, "little")))
    except (MasterRefused, MasterSilent) as error:
        say(f"telemetry stays at {own_ms} ms, the bands get wider: {error}")
        yield
        return
    try:
        yield
    finally:
        station.client.request(Write(period.offset, own_ms.to_bytes(period.size, "little")))
