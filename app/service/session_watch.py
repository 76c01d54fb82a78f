"""Faults that have not tripped anything: searched in the running recording, shown as alarms."""

import contextlib
import logging
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

from app.analysis.root_cause.from_session import causes_without_trip
from app.analysis.root_cause.judge import Cause, trip_cause
from app.clock import Clock
from app.errors import AppError
from app.live.pipeline import Output, Pipeline
from app.sessions.catalogue import Catalogue
from app.sessions.recording.auto_recorder import AutoRecorder
from app.sessions.worker import REPORT, Workers

log = logging.getLogger(__name__)
EVERY_S = 60.0
SHARE = 0.05  # share of a processor, at most
Place = tuple[str, int | None, int | None]


class SessionWatch:
    """The judge of recorded sessions, asked every EVERY_S while one is recorded and once at its end.

    It works in a process of its own. What two looks in a row find is named, or one at the end, and stays until a look
    does not find it any more; a recording that ends says nothing against it.
    """

    def __init__(
        self, recorder: AutoRecorder, catalogue: Catalogue, workers: Workers, pipeline: Pipeline, clock: Clock
    ) -> None:
        self._recorder = recorder
        self._catalogue = catalogue
        self._workers = workers
        self._pipeline = pipeline
        self._clock = clock
        self._session_id: str | None = None
        self._due_ns = 0
        self._is_looking = False
        self._before: set[Place] | None = None  # what the last look found; None: there was none
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="session watch")

    def on_output(self, output: Output, t_mono_ns: int) -> None:
        """Begin a look where one is due."""
        before, self._session_id = self._session_id, self._recorder.session_id
        if self._session_id != before:
            self._due_ns = t_mono_ns + round(EVERY_S * 1e9)
            if before is not None:
                self._begin(before, is_over=True)
        elif self._session_id is not None and t_mono_ns >= self._due_ns and not self._is_looking:
            self._is_looking = True
            self._due_ns = t_mono_ns + round(EVERY_S * 1e9)
            self._begin(self._session_id, is_over=False)

    def wait(self, timeout_s: float | None = None) -> None:
        """Wait until no look is under way.

        Raises:
            TimeoutError: so long was not enough.
            RuntimeError: it was stopped.
        """
        self._thread.submit(int).result(timeout_s)

    def stop(self) -> None:
        """Begin no look any more, and wait for the one under way."""
        self._thread.shutdown(wait=True, cancel_futures=True)

    def _begin(self, session_id: str, *, is_over: bool) -> None:
        with contextlib.suppress(RuntimeError):  # shutting down
            self._thread.submit(self._judge, session_id, is_over)

    def _judge(self, session_id: str, is_over: bool) -> None:
        began_ns = self._clock.monotonic_ns()
        try:
            self._recorder.flush()
            causes = self._workers.run(REPORT, causes_without_trip, self._catalogue.path(session_id))
            self._name(causes, is_over=is_over)
        except AppError as error:
            log.info("the running recording was not evaluated: %s", error)
        except Exception:  # whatever is wrong with a look, the next one is made
            log.exception("a look at the running recording failed")
        finally:
            took_ns = self._clock.monotonic_ns() - began_ns
            self._due_ns = max(self._due_ns, began_ns + round(took_ns / SHARE))
            self._is_looking = False

    def _name(self, causes: Sequence[Cause] | None, *, is_over: bool) -> None:
        if causes is None:
            return
        before, self._before = self._before, {_place(cause) for cause in causes}
        if before is None and not is_over:
            return  # one look ends nothing that was named before a restart
        named = [cause for cause in causes if is_over or _place(cause) in (before or ())]
        self._pipeline.name(tuple(trip_cause(cause) for cause in named))


def _place(cause: Cause) -> Place:
    return cause.code, cause.cell, cause.pack
