"""Where tasks run: a pool of processes here, or a Dask cluster by URL. Both are `concurrent.futures.Executor`."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any

from app.errors import ConfigError, ExtraMissing

CONNECT_S = 20.0
DASK = "dask://"


@dataclass(frozen=True)
class Engine:
    """`new_executor` makes one, again where its processes were lost; `window` is how many tasks are handed over."""

    new_executor: Callable[[], Executor]
    window: int
    is_pool: bool


@contextmanager
def open_engine(url: str, processes: int | None = None) -> Iterator[Engine]:
    """Open `processes`, or `dask://HOST:PORT`, and close it at the end.

    Raises:
        ConfigError: the URL is neither, or nobody answers there.
        ExtraMissing: `distributed` is not installed.
    """
    if url == "processes":
        count = processes or os.cpu_count() or 1
        spawn = get_context("spawn")
        yield Engine(lambda: ProcessPoolExecutor(count, mp_context=spawn), count, is_pool=True)
        return
    address = url.removeprefix(DASK)
    if not url.startswith(DASK) or ":" not in address:
        raise ConfigError("--engine", url, "processes, or dask://HOST:PORT")
    try:
        from distributed import Client
    except ImportError as error:
        raise ExtraMissing("a Dask cluster", "distributed", "cluster") from error
    try:
        client: Any = Client(f"tcp://{address}", timeout=CONNECT_S, set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, TimeoutError) as error:
        raise ConfigError("--engine", url, f"a Dask scheduler that answers: {error}") from error
    try:
        # a task of a worker that is lost is given to another one, as often as the scheduler allows
        window = max(4 * sum(client.nthreads().values()), 64)
        yield Engine(lambda: client.get_executor(pure=False), window, is_pool=False)
    finally:
        with suppress(OSError, TimeoutError):
            client.close(timeout=5)
