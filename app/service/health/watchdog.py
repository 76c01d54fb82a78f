"""Tells systemd that the service is ready, and that it is alive; nothing where systemd did not start it.

The protocol is one datagram to the socket that $NOTIFY_SOCKET names. Source: sd_notify(3), systemd.service(5).
"""

import asyncio
import contextlib
import logging
import os
import socket
from collections.abc import Callable, Mapping, Sequence

from app.words import Message, render

log = logging.getLogger(__name__)
SHARE = 1 / 3  # share of the watchdog's time between two signs of life


def notify(text: str, environment: Mapping[str, str] = os.environ) -> None:
    """Send one message to systemd; without a listener nothing is sent."""
    address = environment.get("NOTIFY_SOCKET", "")
    if not address:
        return
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        sender.setblocking(False)
        sender.sendto(text.encode(), "\0" + address[1:] if address.startswith("@") else address)


def period_s(environment: Mapping[str, str] = os.environ) -> float | None:
    """Return how often systemd wants a sign of life from this process [s]; None where it wants none."""
    wanted, pid = environment.get("WATCHDOG_USEC", ""), environment.get("WATCHDOG_PID")
    if not wanted.isdigit() or int(wanted) == 0 or (pid is not None and pid != str(os.getpid())):
        return None
    return int(wanted) * 1e-6 * SHARE


async def keep_alive(stalls: Callable[[], Sequence[Message]], environment: Mapping[str, str] = os.environ) -> None:
    """Send signs of life until cancelled, none while something stands still: then systemd starts the service again.

    It runs in the event loop, so that a loop that stands still sends none either.
    """
    every_s = period_s(environment)
    if every_s is None:
        return
    was_silent = False
    while True:
        stalled = stalls()
        if stalled:
            why = "; ".join(map(render, stalled))
            if not was_silent:
                log.error("no sign of life to systemd: %s", why)
            notify(f"STATUS={why}", environment)
        else:
            notify("WATCHDOG=1", environment)
        was_silent = bool(stalled)
        await asyncio.sleep(every_s)
