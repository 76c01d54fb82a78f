"""A battery on a real python-can bus: a serial-line CAN adapter (slcan) behind a socket, which speaks its frames."""

import contextlib
import socket
import threading
import time
from collections.abc import Iterable, Iterator

Frame = tuple[int, int, bytes]  # time [ns], id with bit 31 for 29-bit ones, data
LENGTHS = {12: "9", 16: "A", 20: "B", 24: "C", 32: "D", 48: "E", 64: "F"}


def slcan(can_id: int, data: bytes) -> bytes:
    """A frame as an slcan adapter writes it, CAN FD where it is longer than 8 bytes."""
    length = LENGTHS.get(len(data), str(len(data)))
    kind = ("tT" if len(data) <= 8 else "dD")[can_id >> 31]
    number = f"{can_id & 0x1FFFFFFF:08X}" if can_id >> 31 else f"{can_id:03X}"
    return f"{kind}{number}{length}{data.hex().upper()}\r".encode()


class SendingBus:
    """Speaks to whoever connects, in real time, again and again; what it is told is thrown away."""

    def __init__(self, frames: Iterable[Frame]) -> None:
        self.frames = sorted(frames)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._silent = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """What `--can` takes."""
        return f"slcan:socket://127.0.0.1:{self._listener.getsockname()[1]}?sleep_after_open=0&timeout=0.05"

    def fall_silent(self) -> None:
        """Send nothing more; the bus stays open."""
        self._silent.set()

    def close(self) -> None:
        """End the connection."""
        self._silent.set()
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._thread.join(5)

    def _run(self) -> None:
        with contextlib.suppress(OSError):
            peer, _ = self._listener.accept()
            with peer:
                begun = time.monotonic()
                for at_s, line in self._lines():
                    if self._silent.wait(max(0.0, begun + at_s - time.monotonic())):
                        break
                    peer.sendall(line)
                while peer.recv(4096):
                    pass

    def _lines(self) -> Iterator[tuple[float, bytes]]:
        """Frames of each 10 ms together, for ever."""
        length_s = self.frames[-1][0] / 1e9 + 0.01
        lines: dict[int, bytes] = {}
        for t_ns, can_id, data in self.frames:
            slot = t_ns // 10_000_000
            lines[slot] = lines.get(slot, b"") + slcan(can_id, data)
        turn = 0
        while True:
            for slot, line in lines.items():
                yield turn * length_s + slot * 0.01, line
            turn += 1
