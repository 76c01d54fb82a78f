"""`voltwall sessions fetch` and `fill`: what another recorder of the same car has."""

import argparse
import os
import sys

from app.clock import Clock
from app.commands.session_commands.selection import (
    add_session_argument,
    catalogue,
    data_folder,
    find_session,
    new_action,
)
from app.sessions.transfer.fetch import Remote
from app.sessions.transfer.fetch_jobs import Fetch, FetchState
from app.sessions.transfer.fill import fill_gaps


def add_actions(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the actions."""
    fetch = new_action(
        actions, "fetch", "bring the finished sessions of another voltwall, a recorder in the car, here", _fetch
    )
    fetch.epilog = (
        "They are called LABEL-ID here. A transfer that was cut off goes on, and gaps of the sessions recorded here\n"
        "are filled. The other service's password in VOLTWALL_REMOTE_PASSWORD."
    )
    fetch.add_argument("url", metavar="URL", help="the other service, as http://car.local:8000")
    fetch.add_argument("--label", default="", help="what its sessions are called here (default: its host name)")
    fetch.add_argument(
        "--only", action="append", default=[], metavar="ID", help="this session, even while it is recorded"
    )
    fetch.add_argument("--no-fill", action="store_true", help="leave the sessions recorded here as they are")
    fill = new_action(actions, "fill", "put into a session what its link lost and another recorder has", _fill)
    add_session_argument(fill)
    fill.add_argument(
        "--from", dest="source", required=True, metavar="SESSION", help="the other recorder's, id or file"
    )


def _fetch(args: argparse.Namespace) -> int:
    remote = Remote(args.url, label=args.label, password=os.environ.get("VOLTWALL_REMOTE_PASSWORD"))
    folder = data_folder(args) / "sessions"
    shown = _Progress()
    done = Fetch(remote, folder, catalogue(args), Clock(), shown.show).run(args.only, fill=not args.no_fill)
    print(f"{len(done.fetched)} fetched, {done.already_here} were here")
    return 0


def _fill(args: argparse.Namespace) -> int:
    path, source = find_session(args, args.session), find_session(args, args.source)
    filled = fill_gaps(path, source, t_wall_ns=Clock().wall_ns())
    print(f"{path.stem}: {filled} from {source.stem}")
    return 0


class _Progress:
    """A line a session; on a terminal with its share."""

    def __init__(self) -> None:
        self._before = FetchState("")

    def show(self, state: FetchState) -> None:
        """Tell what changed."""
        before, self._before = self._before, state
        if sys.stderr.isatty() and state.total_bytes:
            share = 100 * state.done_bytes / state.total_bytes
            print(f"\r{state.session_id} {share:5.1f} %", end="\n" if share >= 100 else "", file=sys.stderr)
        for session_id in state.fetched[len(before.fetched) :]:
            print(f"{session_id}: {state.total_bytes / 1e6:.1f} MB")
        for text in state.filled[len(before.filled) :]:
            print(text)
