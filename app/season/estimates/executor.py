"""Where sessions are estimated: in worker processes here, or on a Dask cluster by URL."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

from app.errors import ConfigError, ExtraMissing
from app.sessions.worker import DAY, Workers

CONNECT_S = 20.0
DASK = "dask://"


@dataclass(frozen=True)
class Engine:
    """`submit` begins a call of a function; `window` is how many are begun at once."""

    submit: Callable[..., Future[Any]]
    window: int


@contextmanager
def open_engine(url: str, processes: int | None = None) -> Iterator[Engine]:
    """Open `processes`, or `dask://HOST:PORT`, and close it at the end.

    Raises:
        ConfigError: the URL is neither, or nobody answers there.
        ExtraMissing: `distributed` is not installed.
    """
    if url == "processes":
        count = processes or os.cpu_count() or 1
        with closing(Workers(count, most_idle=count)) as workers:
            yield Engine(partial(workers.start, DAY), count)
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
        yield Engine(client.get_executor(pure=False).submit, window)
    finally:
        with suppress(OSError, TimeoutError):
            client.close(timeout=5)
