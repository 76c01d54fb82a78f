"""Mutation testing: mutmut changes the code in one place at a time, and the unit tests have to notice.

Over `firmware_protocol` and the configuration's rules: `make mutation`, about an hour on one core. With names only
these modules: `make mutation ARGS="framing rules"`, a few minutes each. `--again` tries only the mutants that survived
last time, after new tests. A survivor's change is shown by `.venv/bin/mutmut show NAME`.

What is left out of the score, because no test that runs after the import can notice it: functions that only fill a
table while their module is imported. Their tables are compared whole by tests/unit/firmware_protocol. mutmut changes
functions, not constants and not properties: these are pinned by the shared vectors and by the C header.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MUTANTS = ROOT / "mutants"
FLOOR = 0.9
SURVIVED = (0, 5, 33)  # exit statuses of pytest: passed, no test collected; of mutmut: no test calls the function
AT_IMPORT = ("ltc6804.x__pec15_entry__", "dbc_import.x__elements__")


def mutmut(*arguments: str) -> int:
    """Run mutmut with one process and without pytest's plugins, which makes a mutant four times as quick."""
    environment = {**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    command = [sys.executable, "-m", "mutmut", "run", "--max-children", "1", *arguments]
    return subprocess.run(command, cwd=ROOT, env=environment, check=False, stdout=sys.stderr).returncode


def results() -> dict[str, dict[str, int]]:
    """Return {module: {mutant: exit status}} of those that were tried."""
    counts: dict[str, dict[str, int]] = {}
    for path in sorted(MUTANTS.rglob("*.py.meta")):
        statuses = json.loads(path.read_text(encoding="utf-8"))["exit_code_by_key"]
        tried = {
            name: status
            for name, status in statuses.items()
            if status is not None and not any(part in name for part in AT_IMPORT)
        }
        if tried:
            counts[path.name.removesuffix(".py.meta")] = tried
    return counts


def survivors() -> list[str]:
    """Return the mutants that no test noticed."""
    return [name for tried in results().values() for name, status in tried.items() if status in SURVIVED]


def main(argv: list[str]) -> int:
    """Try the mutants, print a score for each module, and return 1 where too many survive."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("modules", nargs="*", help="only these modules, by their last name")
    parser.add_argument("--again", action="store_true", help="only the survivors of the last run")
    arguments = parser.parse_args(argv)
    if arguments.again:
        names = survivors()
    else:
        shutil.rmtree(MUTANTS, ignore_errors=True)
        names = [f"*.{module}.*" for module in arguments.modules]
    status = mutmut(*names)
    if status:
        return status
    for name in survivors():
        print("survived:", name)
    total = killed = 0
    for module, tried in results().items():
        noticed = sum(status not in SURVIVED for status in tried.values())
        print(f"{module:20} {noticed:5} of {len(tried):5}  {noticed / len(tried):.1%}")
        total, killed = total + len(tried), killed + noticed
    score = killed / max(total, 1)
    print(f"mutation score: {score:.1%} of {total} mutants noticed, at least {FLOOR:.0%} asked for")
    return 0 if score >= FLOOR else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
