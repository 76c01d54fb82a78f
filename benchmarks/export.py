"""How long an export takes beside another version of this program: `python -m benchmarks.export --before DIR`.

DIR is a checkout of the other version, an older one, with its .venv. It records a session of the simulated endurance
unless one is named, because it cannot read what a newer version wrote. Each version exports all default signals of a
copy of its own, in a process of its own, in turn, several times. A figure is the median CPU time of one export, after a
first one of a second that imports what the format needs.
"""

import argparse
import json
import shutil
import statistics
import subprocess
import tempfile
from pathlib import Path

FORMATS = ("csv", "parquet", "mf4", "ld", "mcap")
_CHILD = """
import hashlib, importlib, json, sys, time
from pathlib import Path
from app.sessions.export.export import export
try:
    reader = importlib.import_module("app.sessions.reading.reader")
except ModuleNotFoundError:
    reader = importlib.import_module("app.sessions.reader")
path, target, export_format = sys.argv[1:]
with reader.SessionFile(Path(path)) as session:
    start_s = session.info.started_wall_ns / 1e9
    export(session, Path(target), export_format, t_to_s=start_s + 1)
    begun_s = time.process_time()
    export(session, Path(target), export_format)
    spent_s = time.process_time() - begun_s
print(json.dumps([spent_s, hashlib.sha256(Path(target).read_bytes()).hexdigest()]))
"""


def export_once(checkout: Path, session: Path, target: Path, export_format: str) -> tuple[float, str]:
    """Return the CPU time of one export [s] and the digest of the file."""
    command = [str(checkout / ".venv/bin/python"), "-c", _CHILD, str(session), str(target), export_format]
    done = subprocess.run(command, cwd=checkout, check=True, capture_output=True, text=True)
    spent_s, digest = json.loads(done.stdout)
    return spent_s, digest


def main() -> None:
    """Record, export by both in turn, print a line a format."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--before", type=Path, required=True, help="a checkout of the other version, with its .venv")
    parser.add_argument("--session", type=Path, help="export this one instead of a made one")
    parser.add_argument("--minutes", type=float, default=25.0, help="length of the made one (default %(default)s)")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--formats", nargs="+", default=FORMATS)
    arguments = parser.parse_args()
    checkouts = (arguments.before.absolute(), Path.cwd())
    with tempfile.TemporaryDirectory() as folder:
        path = arguments.session or record(checkouts[0], Path(folder), arguments.minutes)
        copies = [Path(shutil.copy(path, Path(folder) / f"{i}.sqlite")) for i in range(2)]
        for export_format in arguments.formats:
            spent_s: tuple[list[float], list[float]] = ([], [])
            digests = ["", ""]
            for _ in range(arguments.runs):
                for i, checkout in enumerate(checkouts):
                    target = Path(folder) / f"export.{export_format}"
                    cpu_s, digests[i] = export_once(checkout, copies[i], target, export_format)
                    spent_s[i].append(cpu_s)
            before_s, after_s = map(statistics.median, spent_s)
            same = "same bytes" if digests[0] == digests[1] else "other bytes"
            print(f"{export_format:8} {before_s:6.2f} s, now {after_s:5.2f} s: {before_s / after_s:.1f} times, {same}")


def record(checkout: Path, folder: Path, minutes: float) -> Path:
    """Record the simulated car's endurance and return the file."""
    seconds = str(60 * minutes)
    python, made = str(checkout / ".venv/bin/python"), str(folder / "made")
    command = [python, "-m", "benchmarks.record_scenario", "clean-endurance", made]
    subprocess.run([*command, "--seconds", seconds], cwd=checkout, check=True, capture_output=True)
    return next((folder / "made").glob("*.sqlite"))


if __name__ == "__main__":
    main()
