"""A radio between pit and car as a forwarder on a port of its own: late, losing, narrow, and sometimes not there.

It stands for TCP over such a radio: what is lost is sent again after a round trip, twice as long each further time, and
what comes behind it waits. All connections share the rate.
"""

import asyncio
import contextlib
import random
import threading
from collections.abc import Coroutine

SEGMENT = 1400  # bytes of a packet
MOST_RETRIES = 6


class BadRadio:
    """Forwards to a port of loopback; `cut` and `repair` may be called from any thread."""

    def __init__(
        self,
        target: tuple[str, int],
        *,
        latency_s: float = 0.0,
        loss: float = 0.0,
        rate_bytes_s: float | None = None,
        seed: int = 1,
    ) -> None:
        """Start it.

        Args:
            target: host and port of the service behind it.
            latency_s: of every packet, one way.
            loss: share of packets that have to be sent again.
            rate_bytes_s: of all connections together, None without limit.
            seed: of the losses.
        """
        self._target = target
        self._latency_s, self._loss, self._rate = latency_s, loss, rate_bytes_s
        self._random = random.Random(seed)
        self._free_s = 0.0  # when the air is free again
        self._open: set[asyncio.StreamWriter] = set()
        self._servers: list[asyncio.Server] = []
        self._tasks: set[object] = set()
        self._is_cut = self._hangs = False
        self.bytes = 0
        self.port = 0
        self._loop = asyncio.new_event_loop()
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        assert self._ready.wait(10)
        self.url = f"http://127.0.0.1:{self.port}"

    def cut(self, *, hangs: bool = False) -> None:
        """Nothing passes any more; what is open breaks, and what is tried is refused, or hangs as on a real radio."""
        self._is_cut, self._hangs = True, hangs
        self._loop.call_soon_threadsafe(self._break_all)

    def repair(self) -> None:
        """Connections that were made from now on pass."""
        self._is_cut = False
        self._loop.call_soon_threadsafe(self._break_all)  # those that were tried meanwhile

    def close(self) -> None:
        """End it."""
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(5)
        assert not self._thread.is_alive()

    def also(self, target: tuple[str, int]) -> int:
        """Forward to a further service through the same air; return the port for it."""
        return asyncio.run_coroutine_threadsafe(self._listen(target), self._loop).result(10)

    def _break_all(self) -> None:
        for writer in self._open:
            writer.transport.abort()
        self._open.clear()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self.port = self._loop.run_until_complete(self._listen(self._target))
        self._ready.set()
        self._loop.run_forever()
        self._loop.run_until_complete(self._end())
        self._loop.close()

    async def _listen(self, target: tuple[str, int]) -> int:
        def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> Coroutine[object, object, None]:
            self._open.add(writer)  # at once: what is accepted as the radio ends is closed too
            return self._serve(reader, writer, target)

        server = await asyncio.start_server(accept, "127.0.0.1", 0)
        self._servers.append(server)
        return int(server.sockets[0].getsockname()[1])

    async def _end(self) -> None:
        for server in self._servers:
            server.close()
        while tasks := asyncio.all_tasks() - {asyncio.current_task()}:  # one that is cancelled may leave another
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
        self._break_all()
        await asyncio.sleep(0)  # a broken connection closes its socket in the loop's next round

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, target: tuple[str, int]) -> None:
        self._tasks.add(asyncio.current_task())  # asyncio itself does not hold it
        if self._is_cut:
            if not self._hangs:
                writer.transport.abort()
            return
        try:
            there_reader, there_writer = await asyncio.open_connection(*target)
            self._open.add(there_writer)
            await asyncio.gather(self._carry(reader, there_writer), self._carry(there_reader, writer))
        except OSError:
            writer.transport.abort()  # nobody is there, or no longer
        self._tasks.discard(asyncio.current_task())

    async def _carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        queue: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue(64)  # what is in the air
        clock = self._loop.time

        async def deliver() -> None:
            while True:
                due_s, data = await queue.get()
                await asyncio.sleep(max(0.0, due_s - clock()))
                if not data:
                    break
                with contextlib.suppress(OSError):
                    if not writer.is_closing():  # what comes behind a broken connection is dropped
                        writer.write(data)
                        await writer.drain()
            writer.close()

        task = asyncio.ensure_future(deliver())
        due_s = 0.0
        with contextlib.suppress(OSError):
            while data := await reader.read(SEGMENT):
                if self._rate is not None:
                    self._free_s = max(self._free_s, clock()) + len(data) / self._rate
                    await asyncio.sleep(self._free_s - clock())
                again = 0
                while again < MOST_RETRIES and self._random.random() < self._loss:
                    again += 1
                way_s = self._latency_s + 2 * self._latency_s * (2**again - 1)
                due_s = max(due_s, clock() + way_s)
                self.bytes += len(data)
                await queue.put((due_s, data))
        await queue.put((due_s, b""))
        with contextlib.suppress(OSError, asyncio.CancelledError):
            await task
