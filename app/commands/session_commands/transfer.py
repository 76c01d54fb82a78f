"""`voltwall sessions fetch` and `fill`: what another recorder of the same car has."""

import argparse
import json
import os
import threading
from pathlib import Path
from typing import Any

from app.clock import Clock
from app.commands.console.progress import Progress
from app.commands.session_commands.selection import (
    catalogue,
    data_folder,
    find_session,
)
from app.sessions.transfer.fetch import Remote
from app.sessions.transfer.fetch_jobs import Fetch, FetchState
from app.sessions.transfer.fill import fill_gaps
from app.sessions.transfer.follow import Follower
from app.sessions.transfer.session_copy import SessionCopy

BAR = 40  # characters
LOOK_S = 2.0


def fetch(args: argparse.Namespace) -> int:
    """Bring another recorder's sessions here."""
    remote = Remote(args.url, label=args.label, password=os.environ.get("VOLTWALL_REMOTE_PASSWORD"), trust=args.trust)
    folder = data_folder(args) / "sessions"
    if args.follow:
        return _follow(Follower(remote, folder, Clock(), order=args.order, note=print), folder)
    shown = _Shown()
    done = Fetch(remote, folder, catalogue(args), Clock(), shown.show).run(args.only, fill=not args.no_fill)
    print(f"{len(done.fetched)} fetched, {done.already_here} were here")
    return 0


def _follow(follower: Follower, folder: Path) -> int:
    """Follow until Ctrl-C; a line whenever something changed."""
    ending = threading.Event()
    thread = threading.Thread(target=follower.run, args=(ending,), name="follow", daemon=True)
    folder.mkdir(parents=True, exist_ok=True)
    thread.start()
    before: list[str] = []
    try:
        while thread.is_alive():
            lines = [_line(copy.state()) for copy in SessionCopy.all_in(folder)]
            if follower.state.error is not None:
                lines.append(str(follower.state.error))
            if lines != before:
                print("\n".join(lines), flush=True)
            before = lines
            thread.join(LOOK_S)
    except KeyboardInterrupt:
        ending.set()
    return 0


def list_missing(args: argparse.Namespace) -> int:
    """Print what is still missing of sessions that are followed."""
    states = [copy.state() for copy in SessionCopy.all_in(data_folder(args) / "sessions")]
    print(json.dumps(states, indent=2) if args.json else "\n".join(map(_line, states)) or "nothing is missing")
    return 0


def _line(state: dict[str, Any]) -> str:
    """A copy with its bar: what is here is full, what is missing is empty, a mixture half."""
    length_s = max(state["pieces"] * state["piece_s"], 1e-9)
    bar = ""
    for step in range(BAR):
        first_s, last_s = (state["started"] + length_s * edge / BAR for edge in (step, step + 1))
        lacking_s = sum(max(0.0, min(end, last_s) - max(start, first_s)) for start, end in state["missing"])
        share = lacking_s / (last_s - first_s)
        bar += "█" if share < 0.01 else "░" if share > 0.99 else "▒"
    what = "being recorded" if state["recording"] else "recorded"
    return f"{state['id']:28} {bar} {state['missing_s']:.0f} s of {length_s:.0f} s missing, {what}"


def fill(args: argparse.Namespace) -> int:
    """Put into a session what another recorder has."""
    path, source = find_session(args, args.session), find_session(args, args.source)
    progress = Progress(path.stem)
    filled = fill_gaps(path, source, t_wall_ns=Clock().wall_ns(), on_progress=progress)
    progress.end()
    print(f"{path.stem}: {filled} from {source.stem}")
    return 0


class _Shown:
    """A line a session; on a terminal how far it is."""

    def __init__(self) -> None:
        self._before = FetchState("")
        self._progress = Progress()

    def show(self, state: FetchState) -> None:
        """Tell what changed."""
        before, self._before = self._before, state
        if state.session_id != before.session_id:
            self._progress = Progress(state.session_id)
        if state.total_bytes:
            self._progress(state.done_bytes, state.total_bytes)
        if state.fetched != before.fetched or state.filled != before.filled:
            self._progress.end()
        for session_id in state.fetched[len(before.fetched) :]:
            print(f"{session_id}: {state.total_bytes / 1e6:.1f} MB")
        for text in state.filled[len(before.filled) :]:
            print(text)
