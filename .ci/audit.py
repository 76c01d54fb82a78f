"""Asks the databases of known holes about every locked package: pip-audit for Python, npm audit for the browser.

`make audit`; it needs the network, so it is no part of CI. Exit status 1: a hole is known. 2: somebody could not be
asked, which is never taken for a good answer; pip-audit itself only warns of packages that it did not find.
"""

from __future__ import annotations

import json
import subprocess
import sys
import venv
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
TOOL = ROOT / ".venv" / "audit"  # apart: its dependencies are none of ours
PIP_AUDIT = "pip-audit==2.10.1"
LOCKS = ("run", "build", "dev", "site")
CLEAN, HOLES, NOT_ASKED = 0, 1, 2


def judge_python(report: dict[str, Any]) -> tuple[int, list[str]]:
    """Return (exit status, lines) for what pip-audit wrote as JSON."""
    packages = report["dependencies"]
    unknown = [one["name"] for one in packages if "skip_reason" in one]
    skipped = [f"the database does not answer for {len(unknown)}: {' '.join(unknown)}"] if unknown else []
    holes = [
        f"{one['name']} {one['version']}: {hole['id']}, mended in {', '.join(hole['fix_versions']) or 'no version'}"
        for one in packages
        for hole in one.get("vulns", ())
    ]
    return HOLES if holes else NOT_ASKED if skipped or not packages else CLEAN, [*holes, *skipped]


def judge_browser(code: int, output: str) -> tuple[int, list[str]]:
    """Return (exit status, lines) for what `npm audit --json` ended with and wrote."""
    try:
        report = json.loads(output[output.index("{") :])
        holes = report["vulnerabilities"]
    except (ValueError, KeyError, TypeError):
        return NOT_ASKED, [f"npm audit gave no report (exit status {code}): {' '.join(output.split())[:300]}"]
    lines = [f"{name}: {hole.get('severity')}, {hole.get('range')}" for name, hole in holes.items()]
    return HOLES if lines else CLEAN, lines


def audit_python(lock: str) -> tuple[int, list[str]]:
    """Ask pip-audit about one lock file."""
    folder = TOOL / ("Scripts" if sys.platform == "win32" else "bin")
    if not (folder / "pip-audit").exists() and not (folder / "pip-audit.exe").exists():
        venv.create(TOOL, with_pip=True)
        made = _run(str(folder / "python"), "-m", "pip", "install", "--quiet", PIP_AUDIT)
        if made.returncode != 0:
            return NOT_ASKED, [f"{PIP_AUDIT} cannot be installed: {made.stderr.strip()[-300:]}"]
    options = ("--disable-pip", "--no-deps", "--progress-spinner", "off", "--format", "json")
    asked = _run(str(folder / "pip-audit"), *options, "--requirement", f"requirements/{lock}.lock")
    try:
        return judge_python(json.loads(asked.stdout))
    except (ValueError, KeyError):
        return NOT_ASKED, [f"pip-audit gave no report (exit status {asked.returncode}): {asked.stderr.strip()[-300:]}"]


def audit_browser() -> tuple[int, list[str]]:
    """Ask npm about package-lock.json."""
    asked = _run(sys.executable, "hatch_build.py", "npm", "audit", "--json")
    return judge_browser(asked.returncode, asked.stdout or asked.stderr)


def _run(*command: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, cwd=ROOT, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)


def main() -> int:
    """Ask about everything, print what is known, and return the worst exit status: a hole before a silence."""
    audits = {f"requirements/{lock}.lock": audit_python(lock) for lock in LOCKS}
    audits["frontend/package-lock.json"] = audit_browser()
    for name, (code, lines) in audits.items():
        print(f"{name}: {('no hole is known', 'HOLES', 'NOT AUDITED')[code]}")
        for line in lines:
            print(f"  {line}")
    codes = [code for code, _ in audits.values()]
    return HOLES if HOLES in codes else max(codes)


if __name__ == "__main__":
    sys.exit(main())
