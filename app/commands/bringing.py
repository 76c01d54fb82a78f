"""`voltwall sessions fetch` and `fill`: what another recorder of the same car has."""

import argparse
import os
import sys
import time
from pathlib import Path

from app.bringing import Brought, Fetch
from app.errors import ConfigError
from app.sessions.catalogue import Catalogue
from app.sessions.fetch import Remote
from app.sessions.fill import fill_gaps

ACTIONS = ("fetch", "fill")
HELP = (
    "fetch    bring the finished sessions of another voltwall, a recorder in the car, here, as LABEL-ID;\n"
    "         goes on where it was cut off, and fills gaps of the sessions recorded here;\n"
    "         its password in VOLTWALL_REMOTE_PASSWORD\n"
    "fill     put into a session what its link lost and the session --from has\n"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what only these actions take."""
    parser.add_argument("--label", default="", help="fetch: what its sessions are called here (default: its host name)")
    parser.add_argument(
        "--only", action="append", default=[], metavar="ID", help="fetch: this session, even while it is recorded"
    )
    parser.add_argument("--no-fill", action="store_true", help="fetch: leave the sessions recorded here as they are")
    parser.add_argument("--from", dest="source", metavar="SESSION", help="fill: the other recorder's, id or file")


def fetch(args: argparse.Namespace, folder: Path) -> int:
    """Fetch from the service at the URL given in place of a session.

    Raises:
        AppError: it does not answer, or a session did not come over whole.
    """
    remote = Remote(args.session, label=args.label, password=os.environ.get("VOLTWALL_REMOTE_PASSWORD"))
    shown = _Progress()
    done = Fetch(remote, folder, Catalogue(folder), shown.show).run(args.only, fill=not args.no_fill)
    print(f"{len(done.fetched)} fetched, {done.already_here} were here")
    return 0


def fill(args: argparse.Namespace, path: Path, source: Path | None) -> int:
    """Fill one session from another.

    Raises:
        ConfigError: no source is named.
        AppError: they are not of the same run, or cannot be read or written.
    """
    if source is None:
        raise ConfigError("from", "(none)", "fill needs --from SESSION, the other recorder's")
    filled = fill_gaps(path, source, t_wall_ns=time.time_ns())
    print(f"{path.stem}: {filled} from {source.stem}")
    return 0


class _Progress:
    """A line a session; on a terminal with its share."""

    def __init__(self) -> None:
        self._before = Brought("")

    def show(self, state: Brought) -> None:
        """Tell what changed."""
        before, self._before = self._before, state
        if sys.stderr.isatty() and state.total_bytes:
            share = 100 * state.done_bytes / state.total_bytes
            print(f"\r{state.session_id} {share:5.1f} %", end="\n" if share >= 100 else "", file=sys.stderr)
        for session_id in state.fetched[len(before.fetched) :]:
            print(f"{session_id}: {state.total_bytes / 1e6:.1f} MB")
        for text in state.filled[len(before.filled) :]:
            print(text)
