"""Finds the Chromium that the browser tests drive, or installs Debian's; says in one line what is missing otherwise.

Exit status: 0 when the tests can run or will skip themselves, 1 when a browser is required (`CI=true`) and absent.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

NAMES = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome", "chrome")  # lightest first
APT = ["apt-get", "-o", "DPkg::Lock::Timeout=120"]


def find_browser() -> str | None:
    """Return the path of the first of the usual names that is on the path."""
    return next((path for path in map(shutil.which, NAMES) if path), None)


def can_install() -> bool:
    """Tell whether apt can bring a real chromium: as root on Debian (Ubuntu's package only points to a snap)."""
    release = Path("/etc/os-release")
    is_debian = release.is_file() and "ID=debian" in release.read_text(encoding="utf-8").splitlines()
    return is_debian and hasattr(os, "geteuid") and os.geteuid() == 0 and shutil.which("apt-get") is not None


def install() -> None:
    """Install Debian's chromium without windows; what apt says goes to standard error, its failure is found later."""
    environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    for arguments in (["update", "-qq"], ["install", "-y", "-qq", "--no-install-recommends", NAMES[0]]):
        subprocess.run([*APT, *arguments], env=environment, stdin=subprocess.DEVNULL, stdout=sys.stderr, check=False)


def main() -> int:
    """Make a browser available if that is possible here."""
    if find_browser() is None and can_install():
        print("chromium is missing: installing it with apt-get", flush=True)
        install()
    if find_browser() is not None:
        return 0
    print(
        "chromium is missing, so the browser tests are skipped: install it (Debian: apt-get install chromium;"
        " macOS: brew install --cask chromium), or put a Chrome on the path",
        flush=True,
    )
    return 1 if os.environ.get("CI") == "true" else 0


if __name__ == "__main__":
    sys.exit(main())
