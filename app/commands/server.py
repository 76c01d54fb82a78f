"""Serves until a signal ends it: the socket, uvicorn, the simulated car where no hardware is named."""

import asyncio
import contextlib
import errno
import os
import signal
import socket
import sys
from collections.abc import Callable, Coroutine
from functools import partial
from typing import Any, TypeVar

import uvicorn

from app.api.access.certificate import Certificate
from app.api.access.phones import EVERY, PhoneAccess
from app.api.application import ServedReplay, create_app, create_fleet_app
from app.api.web.connection import MOST_HANDSHAKES, Connection, server_config
from app.api.web.connection_limits import ACCEPTED_AT_ONCE, ClientConnections, most_connections
from app.commands.tls import Renewal, certificate_of, certificate_text, context_of
from app.errors import ConfigError
from app.service import log
from app.service.health.watchdog import keep_alive, notify
from app.service.host import (
    HighListener,
    locked_folder,
    raise_descriptor_limit,
    release_freed_memory,
    return_freed_memory,
)
from app.service.settings import Settings
from app.service.simulator_process import SimulatorProcess
from app.sessions.worker import command_of
from app.sources.connections import Connections, Setup
from app.sources.loaded_battery import load_battery
from app.telemetry import Source
from app.words import Message

AGAIN = -1  # instead of an exit code
_LISTEN_S = 10.0
T = TypeVar("T")
_CLOSING_S = 2.0  # from the end of most connections of a crowd to that of the rest
_ACCEPT_PAUSE_S = 1024  # connections that the system holds until the service takes them


def serve(settings: Settings, replay: ServedReplay | None = None) -> int:
    """Serve until a signal ends it; what is read cannot be chosen on the page.

    Raises:
        ConfigError: the port is taken, the folder cannot be used or is used by another service.
    """
    return serve_once(settings, replay)[0]


def serve_once(settings: Settings, replay: ServedReplay | None = None, *, is_fixed: bool = True) -> tuple[int, int]:
    """Bind, lock the data folder, run; return the exit code, AGAIN for other connections, and the port.

    Raises:
        ConfigError: the port is taken, the folder cannot be used or is used by another service.
    """
    release_freed_memory()
    sys.setswitchinterval(0.001)  # a frame on its way to the pages does not wait 5 ms for the recorder's thread
    with contextlib.ExitStack() as stack:
        stack.enter_context(locked_folder(settings.data))
        certificate = certificate_of(settings)
        listener = stack.enter_context(_bind(settings))
        if settings.fleet is not None:
            return _run(create_fleet_app(settings), listener, settings, certificate)
        source, serial_url, can_url, car = _source(settings, stack, replay, by_operator=is_fixed)
        in_force = Connections(settings.serial, settings.can, settings.battery)
        setup = Setup(settings.data, in_force, fixed=is_fixed)
        app = create_app(
            settings,
            source,
            serial_url=serial_url,
            can_url=can_url,
            replay=replay,
            simulated_car=car,
            setup=setup,
            certificate=certificate,
        )
        service = app.state.parts.service
        return _run(
            app,
            listener,
            settings,
            certificate,
            setup,
            service.health.stalls,
            partial(service.events.note, "warning", "certificate-renewed"),
            None if replay is not None else app.state.parts.phones,
        )


def _run(
    app: Any,
    listener: socket.socket,
    settings: Settings,
    certificate: Certificate | None,
    setup: Setup | None = None,
    stalls: Callable[[], list[Message]] = list,
    tell: Callable[[Message], None] = lambda message: None,
    phones: PhoneAccess | None = None,
) -> tuple[int, int]:
    """Serve until a signal ends it; return the exit code, AGAIN where the choice of `setup` changed, and the port.

    While `stalls` is empty, systemd's watchdog is served.
    """
    address, port = listener.getsockname()[:2]
    host = f"[{address}]" if ":" in address else address
    context = None if certificate is None else context_of(certificate)
    renewal = None
    if certificate is not None and context is not None:
        renewal = Renewal(settings, certificate, context, tell)
    ready = f"Voltwall: {'https' if certificate else 'http'}://{host}:{port}"
    connections = ClientConnections(most_connections(raise_descriptor_limit()), _return_memory_soon)
    server = _Server(
        ready if certificate is None else f"{ready}\n{certificate_text(certificate, settings, port)}",
        server_config(app, connections, context, backlog=ACCEPTED_AT_ONCE, timeout_graceful_shutdown=2),
        connections,
        stalls,
        renewal,
        phones,
        settings,
    )
    if setup is not None:
        setup.on_choice = server.start_again
    before = {}
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):  # the last of a terminal that is closed; Windows has none
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:  # as nohup asks
            # Until uvicorn listens to it; it ends in order, then raises the signal again
            before[number] = signal.signal(number, lambda *_: setattr(server, "should_exit", True))
    try:
        asyncio.run(server.serve(sockets=[listener]))
    finally:
        for number, handler in before.items():  # one that comes while it starts again ends it
            signal.signal(number, handler)
    if not server.started:
        print("voltwall serve: did not start", file=sys.stderr)
        return 1, port
    return AGAIN if server.is_again else 0, port


def _source(
    settings: Settings, stack: contextlib.ExitStack, replay: ServedReplay | None, *, by_operator: bool
) -> tuple[Source, str | None, str | None, SimulatorProcess | None]:
    """Return (source, RS232 URL, CAN bus, simulator); the simulator is started where no hardware is named.

    What a page kept, `by_operator` false, may name no more than a request.
    """
    if replay is not None:
        return "replay", None, None, None
    Connections(settings.serial, settings.can, settings.battery).check(by_operator=by_operator)
    kind = load_battery(settings.battery).kind
    if not settings.simulates:
        return "serial" if settings.serial else "can", settings.serial, settings.can, None
    of_battery = None if kind == "master" else command_of("app.cli", "simulate", "--battery", settings.battery)
    simulator = SimulatorProcess(settings, of_battery=of_battery, has_serial=kind == "serial")
    stack.callback(simulator.stop)
    simulator.start()
    serial_url = None if kind == "dbc" else simulator.ports.serial_url
    return "simulator", serial_url, None if kind == "serial" else simulator.ports.can_url, simulator


class _Server(uvicorn.Server):
    """Prints its address once it takes connections; may end to be started again."""

    def __init__(
        self,
        ready: str,
        config: uvicorn.Config,
        connections: ClientConnections,
        stalls: Callable[[], list[Message]],
        renewal: Renewal | None,
        phones: PhoneAccess | None,
        settings: Settings,
    ) -> None:
        super().__init__(config)
        self._connections = connections
        self._renewal = renewal
        self._settings = settings
        self._ready_line = ready
        self._stalls = stalls
        self._tasks: list[asyncio.Task[None]] = []
        self._phones = phones
        self._listener: asyncio.Server | None = None  # for phones
        self.is_again = False

    def start_again(self) -> None:
        """End in order, to be started with other connections."""
        self.is_again = True
        self.should_exit = True

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start, print the address, notify systemd."""
        await super().startup(sockets)
        for listener in sockets or ():
            listener.listen(_ACCEPT_PAUSE_S)  # in the kernel: the event loop takes but few at once
        if self.started:
            log.say(self._ready_line)
            notify("READY=1")
            self._tasks.append(asyncio.create_task(keep_alive(self._stalls)))
            if self._renewal is not None:
                self._tasks.append(asyncio.create_task(self._renewal.keep()))
            if self._phones is not None:
                loop = asyncio.get_running_loop()
                self._phones.listen = lambda *wanted: _run_in(loop, self._listen(*wanted))
                self._phones.close = lambda: _run_in(loop, self._close())
                loop.run_in_executor(None, self._phones.resume)

    async def _listen(self, certificate: Certificate, port: int) -> int:
        """Open the listener for phones; they are limited and answered as all clients are."""
        context = context_of(certificate)
        listener = _bind(self._settings.model_copy(update={"host": EVERY, "port": port}))
        make = partial(Connection, self._connections, ClientConnections(MOST_HANDSHAKES), context)
        protocol = partial(make, config=self.config, server_state=self.server_state, app_state=self.lifespan.state)
        loop = asyncio.get_running_loop()
        self._listener = await loop.create_server(protocol, sock=listener, backlog=ACCEPTED_AT_ONCE)
        listener.listen(_ACCEPT_PAUSE_S)
        self.servers.append(self._listener)
        renewal = Renewal(self._settings, certificate, context, lambda message: None)
        self._tasks.append(asyncio.create_task(renewal.keep()))
        return int(listener.getsockname()[1])

    async def _close(self) -> None:
        if self._listener is None:
            return
        port = self._listener.sockets[0].getsockname()[1]
        self._listener.close()
        self.servers.remove(self._listener)
        self._listener = None
        for connection in list(self._connections):
            if isinstance(connection, Connection) and connection.local_port == port:
                connection.cut()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Notify systemd and end."""
        for task in self._tasks:
            task.cancel()
        if not self.is_again:
            notify("STOPPING=1")
        for connection in self._connections:
            connection.shutdown()
        await super().shutdown(sockets)


def _run_in(loop: asyncio.AbstractEventLoop, work: Coroutine[Any, Any, T]) -> T:
    """Do it in the event loop, from another thread."""
    return asyncio.run_coroutine_threadsafe(work, loop).result(_LISTEN_S)


def _return_memory_soon() -> None:
    """Return the memory of connections to the system once they are closed, in a thread of its own."""
    loop = asyncio.get_running_loop()
    loop.call_later(_CLOSING_S, loop.run_in_executor, None, return_freed_memory)


def _bind(settings: Settings) -> socket.socket:
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    listener = HighListener(family, socket.SOCK_STREAM)
    if os.name == "posix":
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    else:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)  # type: ignore[attr-defined,unused-ignore]
    try:
        listener.bind((settings.host, settings.port))
    except OSError as error:
        listener.close()
        if error.errno == errno.EADDRINUSE:
            raise ConfigError("port", settings.port, Message("port-taken")) from error
        reason = error.strerror or str(error)
        raise ConfigError("host", f"{settings.host}:{settings.port}", reason) from error
    return listener
