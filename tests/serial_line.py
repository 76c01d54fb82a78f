"""A battery at the other end of a pseudo-terminal: answers requests, or sends by itself once it was started."""

import os
import select
import threading
import time
import tty
from collections.abc import Callable, Mapping


class SerialLine:
    """Answers each request with its frames; `stream(k)` gives what is sent every `period_s` from `start` to `stop`."""

    def __init__(
        self,
        answers: Mapping[bytes, bytes] | None = None,
        *,
        stream: Callable[[int], bytes] | None = None,
        start: bytes = b"",
        stop: bytes = b"y",
        period_s: float = 0.5,
    ) -> None:
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._ours)
        self.url = os.ttyname(self._theirs)
        self.received = b""
        self._answers = dict(answers or {})
        self._stream, self._start, self._stop, self._period_s = stream, start, stop, period_s
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End it."""
        self._ended.set()
        self._thread.join()
        os.close(self._theirs)
        os.close(self._ours)

    def _run(self) -> None:
        waiting, sent, due_s = b"", 0, 0.0
        streams = not self._start
        while not self._ended.is_set():
            if select.select([self._ours], [], [], 0.02)[0]:
                data = os.read(self._ours, 4096)
                self.received += data
                waiting += data
                if self._start and self._start in data:
                    streams, due_s = True, time.monotonic()
                streams = streams and self._stop not in data
            for request, answer in self._answers.items():
                if request in waiting:
                    waiting = waiting.replace(request, b"")
                    os.write(self._ours, answer)
            if self._stream is not None and streams and time.monotonic() >= due_s:
                os.write(self._ours, self._stream(sent))
                sent, due_s = sent + 1, due_s + self._period_s
