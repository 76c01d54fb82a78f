"""Resolves pyproject.toml into the lock files: exact versions with hashes, for every platform, no index address.

`run` is the program with what its pages offer and a logger needs, `build` makes the wheel, `dev` holds both and all
tools, `site` makes the documentation's site. The extra `pybamm` is in none: 800 MB
for one benchmark.
Versions already locked stay; `--upgrade` takes the newest that pyproject.toml allows.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
EXTRAS = (
    *("parquet", "mcap", "mf4", "dbc", "mqtt", "plot", "multicast", "season", "cluster", "completion"),
    *("excel", "neware", "serial-pattern"),
)
RUN_EXTRAS = ("parquet", "mcap", "mqtt", "dbc", "season")
LOCKS = {
    "run": ["pyproject.toml", *(word for extra in RUN_EXTRAS for word in ("--extra", extra))],
    "build": ["--group", "build", "--constraint", "requirements/run.lock"],
    "dev": [
        *("pyproject.toml", "--group", "dev", "--group", "bench"),
        *(word for extra in EXTRAS for word in ("--extra", extra)),
        *("--constraint", "requirements/run.lock", "--constraint", "requirements/build.lock"),
    ],
    "site": ["--group", "site", "--constraint", "requirements/dev.lock"],  # next to dev in one environment
}
OPTIONS = [
    *("--universal", "--python-version", "3.11", "--fork-strategy", "fewest"),
    *("--generate-hashes", "--no-header", "--no-annotate", "--no-emit-index-url", "--quiet"),
]


def main(arguments: list[str]) -> int:
    """Write `requirements/*.lock` and return 0, or the resolver's exit status."""
    for name, source in LOCKS.items():
        command = ["uv", "pip", "compile", *source, *OPTIONS, *arguments, "--output-file", f"requirements/{name}.lock"]
        status = subprocess.run([sys.executable, "-m", *command], cwd=ROOT, check=False).returncode
        if status != 0:
            return status
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
