"""Checks subjects of commits: `area: verb object`, at most 60 characters. `make` installs it as the hook commit-msg.

python .ci/commit_subject.py FILE      the message that git is about to commit
python .ci/commit_subject.py --since   every commit after the one that added this file, as far as history is here
python .ci/commit_subject.py --install the hook, where there is a repository and no other hook
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

LONGEST = 60
PATTERN = re.compile(r"[a-z0-9][a-z0-9 ./_-]*: \S.*[^.\s]")
MADE_BY_GIT = ("Merge ", "Revert ", "fixup! ", "squash! ")


def problem(subject: str) -> str | None:
    """Return what is wrong with a subject, None where nothing is."""
    if subject.startswith(MADE_BY_GIT):
        return None
    if len(subject) > LONGEST:
        return f"{len(subject)} characters, at most {LONGEST}"
    return None if PATTERN.fullmatch(subject) else "not `area: verb object` without a full stop"


def subjects_since() -> list[str]:
    """Return subjects after the commit that added this file; none where git or history is missing."""
    here = Path(__file__).resolve()
    try:
        added = _git(here.parent, "log", "--diff-filter=A", "--format=%H", "--", here.name).split()
        parents = _git(here.parent, "rev-list", "--parents", "-n", "1", added[-1]).split()[1:] if added else []
        # a first commit that holds everything is a squashed or shallow history: nothing before it is known
        return (
            _git(here.parent, "log", "--no-merges", "--format=%s", f"{added[-1]}..HEAD").splitlines() if parents else []
        )
    except (OSError, subprocess.CalledProcessError):
        return []


def install() -> None:
    """Write the hook of the repository; nothing without one, or where it has another hook."""
    here = Path(__file__).resolve()
    try:
        hook = here.parent / _git(here.parent, "rev-parse", "--git-path", "hooks/commit-msg").strip()
    except (OSError, subprocess.CalledProcessError):
        return
    if not hook.exists() or here.name in hook.read_text(encoding="utf-8"):
        hook.parent.mkdir(exist_ok=True)
        hook.write_text(f'#!/bin/sh\nexec python3 .ci/{here.name} "$1"\n', encoding="utf-8")
        hook.chmod(0o755)


def _git(folder: Path, *arguments: str) -> str:
    run = subprocess.run(["git", "-C", str(folder), *arguments], capture_output=True, text=True, check=True)
    return run.stdout


def main(arguments: list[str]) -> int:
    """Check; 1 where a subject is wrong."""
    if arguments == ["--install"]:
        install()
        return 0
    if arguments == ["--since"]:
        subjects = subjects_since()
    else:
        lines = Path(arguments[0]).read_text(encoding="utf-8").splitlines()
        subjects = [next((line for line in lines if line and not line.startswith("#")), "")]
    wrong = [(subject, why) for subject in subjects if (why := problem(subject)) is not None]
    for subject, why in wrong:
        print(f"{subject}\n  {why}", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
