"""A real server behind the limits of a connection, whose clock a test can put forward."""

import asyncio
import contextlib
import gc
import socket
import ssl
import threading
import weakref

import httpx
import uvicorn

from app.api.web.connection import CONNECTION, server_config
from app.api.web.connection_limits import ClientConnections
from app.commands.tls import context_of
from tests.service_process import until
from tests.tls_clients import trusting_all

STEP_S = 0.05  # less than what a connection takes for a delay of the service
HIGH_WATER = 65_536  # uvicorn reads no further while more than that waits for the application


class Loop(asyncio.SelectorEventLoop):
    """Real time, and what was skipped."""

    skipped_s = 0.0

    def time(self):
        return super().time() + self.skipped_s


class Tracked(ClientConnections):
    """Knows those that are still in memory, open or not."""

    def __init__(self, most):
        super().__init__(most)
        self.n_added, self.kept = 0, weakref.WeakSet()

    def add(self, connection):
        self.n_added += 1
        self.kept.add(connection)
        return super().add(connection)


class Served:
    """Answers with the body of a request, once it may; websockets are kept in `readers` until they end."""

    def __init__(self, most, certificate=None):
        self.context = None if certificate is None else trusting_all()
        self.connections = Tracked(most)
        self.readers, self.n_taken, self.answer = [], 0, None
        self.may_take = asyncio.Event()
        self.may_take.set()
        context = None if certificate is None else context_of(certificate)
        config = server_config(self.app, self.connections, context, lifespan="off", interface="asgi3")
        self.server = uvicorn.Server(config)
        listener = socket.create_server(("127.0.0.1", 0))
        self.address = listener.getsockname()
        self.url = "{}://{}:{}/".format("http" if context is None else "https", *self.address)
        self.loop = Loop()
        self.thread = threading.Thread(target=self._run, args=(listener,))
        self.thread.start()
        until(lambda: self.server.started)

    def _run(self, listener):
        with asyncio.Runner(loop_factory=lambda: self.loop) as runner:
            runner.run(self.server._serve([listener]))

    def stop(self):
        self.server.should_exit = True
        self.take()
        self.thread.join()

    async def app(self, scope, receive, send):
        if scope["type"] == "websocket":
            await send({"type": "websocket.accept"})
            self.readers.append((scope["state"][CONNECTION], send))
            while (await receive())["type"] != "websocket.disconnect":
                pass
            self.readers.remove((scope["state"][CONNECTION], send))
            return
        if scope["path"] == "/refused":
            await send({"type": "http.response.start", "status": 401, "headers": [(b"content-length", b"0")]})
            await send({"type": "http.response.body"})
            return
        await self.may_take.wait()
        body, more = bytearray(), True
        while more:
            message = await receive()
            if message["type"] == "http.disconnect":
                return
            body += message.get("body", b"")
            self.n_taken = len(body)
            more = message.get("more_body", False)
        answer = bytes(body) if self.answer is None else self.answer
        await send(
            {"type": "http.response.start", "status": 200, "headers": [(b"content-length", b"%d" % len(answer))]}
        )
        await send({"type": "http.response.body", "body": answer})

    def take(self, does=True):
        """Let the application take requests, or no more."""
        self.loop.call_soon_threadsafe(self.may_take.set if does else self.may_take.clear)

    def on_loop(self, work):
        """Run a coroutine on the server's loop."""
        return asyncio.run_coroutine_threadsafe(work, self.loop).result(60)

    def skip(self, seconds):
        """Let time pass without a delay of the service."""

        async def step():
            for _ in range(round(seconds / STEP_S)):
                self.loop.skipped_s += STEP_S
                await asyncio.sleep(0)

        self.on_loop(step())

    def stand_still(self, seconds):
        """Let time pass in which the service does nothing; what clients sent meanwhile is there."""

        async def jump():
            self.loop.skipped_s += seconds

        self.on_loop(jump())

    def open(self, *parts, receive_bytes=None):
        """Connect, shake hands where it is TLS, send."""
        made = self.open_plain(receive_bytes=receive_bytes)
        if self.context is not None:
            made = self.context.wrap_socket(made, suppress_ragged_eofs=False)
        for part in parts:
            made.sendall(part)
        return made

    def open_plain(self, first=b"", receive_bytes=None):
        made = socket.socket()
        if receive_bytes is not None:
            made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_bytes)
        made.setsockopt(
            socket.IPPROTO_TCP, socket.TCP_NODELAY, 1
        )  # the test's time passes faster than an answer of TCP
        made.settimeout(20)
        made.connect(self.address)
        made.sendall(first)
        return made

    @contextlib.contextmanager
    def all_freed(self):
        """Check that connections closed within are freed without garbage collection: it would let a flood pile up."""
        gc.disable()
        try:
            yield
            until(lambda: self.connections.n_added and not self.connections.kept)
        finally:
            gc.enable()

    def post(self, body=b"well"):
        return httpx.post(self.url, content=body, verify=False, timeout=20)


def rest_of(connection):
    """Return what comes until the other side has closed."""
    found = bytearray()
    with contextlib.suppress(ConnectionError, ssl.SSLError):
        while data := connection.recv(1 << 16):
            found += data
    return bytes(found)
