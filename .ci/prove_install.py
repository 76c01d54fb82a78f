"""Proves that `pip install .` gives the whole program: isolated build, fresh environment, the page served.

In a folder with an `app.py` and a `simulator.py` of the user's, which are none of its business.

Works on a copy of what git tracks, so nothing that lies about in the checkout can help. With a folder of wheels it
installs the one for this machine instead: `python3.12 .ci/prove_install.py dist`.
"""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
START_UP_LIMIT_S = 60.0  # on a machine that does other things next to it


def main(arguments: list[str]) -> int:
    """Install, start, ask for the page; return 0 when all of it worked."""
    with tempfile.TemporaryDirectory(prefix="voltwall-install-") as name:
        folder = Path(name)
        run(sys.executable, "-m", "venv", str(folder / "venv"))
        programs = folder / "venv" / ("Scripts" if os.name == "nt" else "bin")
        install = (str(programs / "python"), "-m", "pip", "install", "--quiet", "--disable-pip-version-check")
        if arguments:
            run(*install, "--no-deps", "--no-index", "--find-links", arguments[0], "voltwall")
            run(*install, "voltwall")  # what it needs
        else:
            source = copy_tracked(folder / "source")
            run(*install, str(source))
            shutil.rmtree(source)
        voltwall = programs / "voltwall"
        for taken in ("app", "simulator", "firmware_protocol"):  # modules of the user's, next to which it has to work
            (folder / f"{taken}.py").write_text(f"raise ImportError('not the {taken} that you look for')\n")
        version = run(str(voltwall), "--version", cwd=folder).strip()
        run(
            str(programs / "python"),
            "-c",
            "import voltwall; voltwall.open; voltwall.connect; voltwall.season",
            cwd=folder,
        )
        page = first_page(voltwall, folder)
    what = f"the wheel of {arguments[0]}" if arguments else "pip install ."
    on = f"Python {sys.version.split()[0]}"
    print(f"{what} in a fresh environment, {on}: {version}, page of {len(page)} bytes served")
    return 0


def copy_tracked(target: Path) -> Path:
    """Copy the files that git tracks into `target` and return it."""
    for name in run("git", "ls-files", "-z", cwd=ROOT).split("\0"):
        if name and (ROOT / name).is_file():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, target / name)
    return target


def first_page(voltwall: Path, folder: Path) -> str:
    """Start the service on a free port, return the page at `/`, and end the service.

    Raises:
        TimeoutError: no page within the limit.
    """
    port = free_port()
    service = subprocess.Popen(
        [str(voltwall), "serve", "--port", str(port), "--data", str(folder / "data"), "--log-level", "warning"],
        cwd=folder,
        stdin=subprocess.DEVNULL,
    )
    try:
        deadline_s = time.monotonic() + START_UP_LIMIT_S
        while service.poll() is None and time.monotonic() < deadline_s:
            try:
                with urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=2) as answer:
                    page = str(answer.read().decode())
            except OSError:  # nobody listens yet, or does not answer within the timeout
                time.sleep(0.1)
                continue
            if "<script" not in page:
                raise ValueError(f"no application in the page: {page[:200]}")
            return page
        raise TimeoutError(f"no page within {START_UP_LIMIT_S:.0f} s")
    finally:
        service.terminate()
        service.wait(timeout=START_UP_LIMIT_S)


def free_port() -> int:
    """Return a port that nobody listens on at this moment."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def run(*command: str, cwd: Path | None = None) -> str:
    """Return what the command prints.

    Raises:
        subprocess.CalledProcessError: it failed; its messages went to standard error.
    """
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    answer = subprocess.run(
        command, cwd=cwd, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True, check=True
    )
    return answer.stdout


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
