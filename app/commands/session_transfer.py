"""`voltwall sessions fetch`, `missing` and `fill`: what another recorder of the same car has."""

from __future__ import annotations

import argparse
import json
import os
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from app.clock import Clock
from app.commands.arguments import (
    Actions,
    add_json_argument,
    add_session_argument,
    add_trust_argument,
    data_folder,
    find_session,
    new_action,
)
from app.commands.console import Progress
from app.words import Message, render

if TYPE_CHECKING:
    from app.sessions.transfer.fetch_jobs import FetchState
    from app.sessions.transfer.follow import Follower

BAR = 40  # characters
POLL_S = 2.0


def add_arguments(actions: Actions) -> None:
    """Declare the actions."""
    text = "download sessions from another Voltwall, such as the recorder in the car"
    fetching = new_action(actions, "fetch", text, fetch)
    fetching.epilog = (
        "Downloaded sessions are named LABEL-ID. An interrupted transfer resumes, and gaps of local sessions\n"
        "are filled. With --follow it runs until Ctrl+C and resumes when started again.\n"
        "Set the other service's password or token in VOLTWALL_REMOTE_PASSWORD."
    )
    add_trust_argument(fetching)
    fetching.add_argument("url", metavar="URL", help="URL of the other service, such as http://car.local:8000")
    fetching.add_argument("--label", default="", help="prefix of its sessions here (default: its host name)")
    fetching.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="ID",
        help="only this session, even while it is recorded; repeatable",
    )
    fetching.add_argument("--no-fill", action="store_true", help="do not fill gaps of local sessions")
    fetching.add_argument(
        "--follow",
        action="store_true",
        help="keep following until Ctrl+C, including running recordings: for lossy radio links",
    )
    fetching.add_argument(
        "--order", choices=("oldest", "newest"), default="oldest", help="with --follow: which data is copied first"
    )
    text = "list missing data of followed sessions"
    add_json_argument(new_action(actions, "missing", text, list_missing))
    text = "fill gaps of a session from another recorder"
    filling = new_action(actions, "fill", text, fill)
    add_session_argument(filling)
    filling.add_argument(
        "--from", dest="source", required=True, metavar="SESSION", help="session of the other recorder, ID or file"
    )


def fetch(args: argparse.Namespace) -> int:
    """Bring another recorder's sessions here."""
    from app.sessions.catalogue import Catalogue
    from app.sessions.transfer.fetch import Remote
    from app.sessions.transfer.fetch_jobs import Fetch
    from app.sessions.transfer.follow import Follower

    remote = Remote(args.url, label=args.label, password=os.environ.get("VOLTWALL_REMOTE_PASSWORD"), trust=args.trust)
    folder = data_folder(args) / "sessions"
    if args.follow:
        return _follow(Follower(remote, folder, Clock(), order=args.order, note=_print), folder)
    with _Shown() as shown:
        done = Fetch(remote, folder, Catalogue(folder), Clock(), shown.show).run(args.only, fill=not args.no_fill)
    print(f"{len(done.fetched)} fetched, {done.already_here} were here")
    return 0


def _follow(follower: Follower, folder: Path) -> int:
    """Follow until Ctrl-C; a line whenever something changed."""
    from app.sessions.transfer.session_copy import SessionCopy

    ending = threading.Event()
    thread = threading.Thread(target=follower.run, args=(ending,), name="follow", daemon=True)
    folder.mkdir(parents=True, exist_ok=True)
    thread.start()
    before: list[str] = []
    try:
        while thread.is_alive():
            lines = [_line(copy.state()) for copy in SessionCopy.all_in(folder)]
            if follower.state.error is not None:
                lines.append(render(follower.state.error))
            if lines != before:
                print("\n".join(lines), flush=True)
            before = lines
            thread.join(POLL_S)
    except KeyboardInterrupt:
        ending.set()
    return 0


def _print(message: Message) -> None:
    print(render(message), flush=True)


def list_missing(args: argparse.Namespace) -> int:
    """Print what is still missing of sessions that are followed."""
    from app.sessions.transfer.session_copy import SessionCopy

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
    from app.sessions.transfer.fill import fill_gaps

    path, source = find_session(args, args.session), find_session(args, args.source)
    with Progress(path.stem) as progress:
        filled = fill_gaps(path, source, t_wall_ns=Clock().wall_ns(), on_progress=progress)
    print(f"{path.stem}: {render(filled.message(source.stem))}")
    return 0


class _Shown:
    """A line a session; on a terminal how far it is."""

    def __init__(self) -> None:
        self._id, self._fetched, self._filled = "", 0, 0
        self._progress = Progress()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.end()

    def show(self, state: FetchState) -> None:
        """Show what changed."""
        if state.session_id != self._id:
            self._id, self._progress = state.session_id, Progress(state.session_id)
        if state.total_bytes:
            self._progress(state.done_bytes, state.total_bytes)
        lines = [f"{name}: {state.total_bytes / 1e6:.1f} MB" for name in state.fetched[self._fetched :]]
        lines += map(render, state.filled[self._filled :])
        if lines:
            self._progress.end()
            print("\n".join(lines))
        self._fetched, self._filled = len(state.fetched), len(state.filled)
