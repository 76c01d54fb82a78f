"""Proves the Dockerfile where no Docker engine is at hand: carries out its steps in chroots made from Debian packages.

`sudo python3.11 .ci/prove_image.py [--folder DIR]` needs debootstrap, unshare (util-linux), ip (iproute2), 4 GB and
minutes; it is not part of CI. A stage starts from a minimal Debian bookworm with its python3.11, which stands in for
`python:3.11-slim-bookworm`. RUN, COPY, ENV, WORKDIR and USER act as Docker's would, .dockerignore is honoured. Then CMD
is started as the image's user, in a network namespace of its own, as compose.yaml has it: the root read-only, /tmp in
memory, no capabilities and no way to new ones. HEALTHCHECK must succeed; a session file must appear in the volume,
grow, and be sound after SIGTERM.
"""

from __future__ import annotations

import argparse
import fnmatch
import json
import os
import re
import shlex
import shutil
import sqlite3
import subprocess
import sys
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = "python3.11,python3.11-venv,python3-distutils,ca-certificates"
BUILD_ENVIRONMENT = re.compile(r"(PIP_|SSL_|NODE_EXTRA|REQUESTS_|https?_proxy$|no_proxy$)", re.IGNORECASE)
FROM_HOST = ("/etc/resolv.conf", "/etc/pip.conf", "/etc/ssl/certs/ca-certificates.crt")
POWERLESS = ("--inh-caps=-all", "--bounding-set=-all", "--no-new-privs")
DEADLINE_S = 60.0
RECORDING_S = 10.0


@dataclass
class Stage:
    """One stage of the build and what its instructions have set so far."""

    root: str
    env: dict[str, str] = field(default_factory=lambda: {"PATH": "/usr/local/bin:/usr/bin:/bin:/usr/sbin:/sbin"})
    user: str = "root"
    folder: str = "/"
    volume: str = ""
    command: list[str] = field(default_factory=list)
    health: list[str] = field(default_factory=list)


def instructions(dockerfile: str) -> list[tuple[str, str]]:
    """Return (INSTRUCTION, rest) in order; comments dropped, continued lines joined."""
    text = re.sub(r"\\\n", " ", re.sub(r"(?m)^\s*#.*\n?", "", dockerfile))
    pairs = [line.strip().split(None, 1) for line in text.splitlines() if line.strip()]
    return [(pair[0].upper(), pair[1]) for pair in pairs]


def build(folder: Path) -> Stage:
    """Carry out every instruction and return the last stage.

    Raises:
        ValueError: an instruction that this script does not know.
        subprocess.CalledProcessError: a RUN step failed.
    """
    base = debian(folder / "base")
    stages: dict[str, Stage] = {}
    for word, rest in instructions((ROOT / "Dockerfile").read_text(encoding="utf-8")):
        print(f"{word} {rest}", flush=True)
        if word == "FROM":
            name = rest.split()[2] if " AS " in rest.upper() else "last"
            stage = stages[name] = start_stage(base, folder / name)
        elif word == "RUN":
            in_chroot(stage, ["/bin/sh", "-c", rest], build_environment())
        elif word == "COPY":
            copy(stage, rest, stages)
        elif word == "ENV":
            name, value = rest.split("=", 1)
            stage.env[name] = value
        elif word == "WORKDIR":
            stage.folder = rest
            Path(stage.root + rest).mkdir(parents=True, exist_ok=True)
        elif word == "USER":
            stage.user = rest
        elif word == "VOLUME":
            stage.volume = rest
        elif word == "HEALTHCHECK":
            stage.health = json.loads(rest.split("CMD ", 1)[1])
        elif word == "CMD":
            stage.command = json.loads(rest)
        elif word not in ("EXPOSE", "STOPSIGNAL"):
            raise ValueError(f"{word}: not known here")
    return stage


def debian(base: Path) -> Path:
    """Make the minimal Debian, once a folder."""
    if not (base / "usr/bin/python3.11").exists():
        subprocess.run(["debootstrap", "--variant=minbase", f"--include={PACKAGES}", "bookworm", str(base)], check=True)
    return base


def start_stage(base: Path, root: Path) -> Stage:
    """Copy the base into a new stage, with what a build needs to reach the registries from here."""
    shutil.rmtree(root, ignore_errors=True)
    subprocess.run(["cp", "-a", "--reflink=auto", str(base), str(root)], check=True)
    for name in ("python", "python3"):
        (root / "usr/local/bin" / name).symlink_to("/usr/bin/python3.11")
    for name in FROM_HOST:
        if Path(name).is_file():
            shutil.copyfile(name, f"{root}{name}")
    return Stage(str(root))


def build_environment() -> dict[str, str]:
    """Return the variables that lead to the registries on this machine; Docker would take them as build arguments."""
    return {name: value for name, value in os.environ.items() if BUILD_ENVIRONMENT.match(name)}


def chroot_command(stage: Stage, command: list[str], extra: dict[str, str]) -> list[str]:
    """Return the command that runs `command` in the stage as its user; to be called in a mount namespace.

    Only root has capabilities, in the steps of the build.
    """
    env = {**stage.env, "HOME": "/root" if stage.user == "root" else f"/home/{stage.user}", **extra}
    change = f"cd {shlex.quote(stage.folder)} && exec {shlex.join(command)}"
    setting = ["env", "-i", *(f"{name}={value}" for name, value in env.items())]
    user = stage.user
    becoming = [] if user == "root" else ["setpriv", f"--reuid={user}", f"--regid={user}", "--init-groups", *POWERLESS]
    return ["chroot", stage.root, *becoming, *setting, "/bin/sh", "-c", change]


def mounts(stage: Stage) -> str:
    """Return the shell line that gives the stage /proc and /dev."""
    root = shlex.quote(stage.root)
    return f"mount -t proc proc {root}/proc && mount --rbind /dev {root}/dev"


def sealed(stage: Stage) -> str:
    """Return the shell line that makes the stage read-only but for its volume, and puts /tmp into memory."""
    root, volume = shlex.quote(stage.root), shlex.quote(stage.root + stage.volume)
    return (
        f"mount --rbind {root} {root} && mount --bind {volume} {volume} && mount -o remount,bind,ro {root}"
        f" && mount -t tmpfs -o size=256m,noexec,nosuid,nodev tmpfs {root}/tmp"
    )


def in_chroot(stage: Stage, command: list[str], extra: dict[str, str]) -> None:
    """Run one command in the stage.

    Raises:
        subprocess.CalledProcessError: it failed.
    """
    line = f"{mounts(stage)} && exec {shlex.join(chroot_command(stage, command, extra))}"
    subprocess.run(["unshare", "--mount", "/bin/sh", "-c", line], stdin=subprocess.DEVNULL, check=True)


def copy(stage: Stage, rest: str, stages: dict[str, Stage]) -> None:
    """Carry out COPY, from the build context or from another stage."""
    words = rest.split()
    source_root = ROOT
    if words[0].startswith("--from="):
        source_root = Path(stages[words.pop(0).removeprefix("--from=")].root)
    *sources, target = words
    target_folder = Path(stage.root + (target if target.startswith("/") else f"{stage.folder}/{target}"))
    patterns = (ROOT / ".dockerignore").read_text(encoding="utf-8").split() if source_root == ROOT else []
    for source in sources:
        origin = source_root / source.strip("/")
        shutil.copytree(
            origin,
            target_folder,
            symlinks=True,
            dirs_exist_ok=True,
            ignore=lambda at, names: ignored(at, names, patterns),
        )


def ignored(at: str, names: list[str], patterns: list[str]) -> set[str]:
    """Return the names in folder `at` that .dockerignore leaves out."""
    inside = Path(at).resolve()
    relative = {name: os.path.relpath(inside / name, ROOT) for name in names}
    excluded = set()
    for name, path in relative.items():
        for pattern in patterns:
            anywhere = pattern.startswith("**/") and fnmatch.fnmatch(name, pattern.removeprefix("**/"))
            if anywhere or (("/" not in path or "/" in pattern) and fnmatch.fnmatch(path, pattern)):
                excluded.add(name)
    return excluded


def check_service(stage: Stage) -> None:
    """Start CMD as the image's user, wait for HEALTHCHECK, let it record, stop it and look at the file.

    Runs in namespaces of its own: nothing outside can reach the service.

    Raises:
        RuntimeError: what did not hold.
    """
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
    subprocess.run(["/bin/sh", "-c", f"{sealed(stage)} && {mounts(stage)}"], check=True)
    started_s = time.monotonic()
    extra = {"VOLTWALL_PASSWORD": "engineer-of-the-proof", "VOLTWALL_TLS": "1"}
    service = subprocess.Popen(chroot_command(stage, stage.command, extra), stdin=subprocess.DEVNULL)
    try:
        probe = chroot_command(stage, stage.health, {})
        while subprocess.run(probe, stderr=subprocess.DEVNULL, check=False).returncode != 0:
            if service.poll() is not None or time.monotonic() - started_s > DEADLINE_S:
                raise RuntimeError("the health check never succeeded")
            time.sleep(0.2)
        print(f"healthy {time.monotonic() - started_s:.1f} s after the start")
        user_id = Path(f"/proc/{service.pid}").stat().st_uid
        if user_id == 0:
            raise RuntimeError("the service runs as root")
        caps = dict(re.findall(r"(?m)^(\w+):\t(\w+)", Path(f"/proc/{service.pid}/status").read_text(encoding="ascii")))
        if any(int(caps[name], 16) for name in ("CapInh", "CapPrm", "CapEff", "CapBnd", "CapAmb")):
            raise RuntimeError("the service has capabilities")
        if caps["NoNewPrivs"] != "1":
            raise RuntimeError("the service may gain privileges")
        write = subprocess.run(
            chroot_command(stage, ["touch", "/opt/voltwall/mark"], {}), capture_output=True, check=False
        )
        if b"Read-only file system" not in write.stderr:
            raise RuntimeError("the root can be written")
        print("no capabilities, no new privileges, read-only root")
        volume = Path(stage.root + stage.volume)
        while not list(volume.rglob("sessions/*.sqlite")):
            if service.poll() is not None or time.monotonic() - started_s > DEADLINE_S:
                raise RuntimeError(f"no session file in {stage.volume}")
            time.sleep(0.2)
        print(f"recording {time.monotonic() - started_s:.1f} s after the start")
        time.sleep(RECORDING_S)
    finally:
        service.terminate()
        status = service.wait(timeout=20)
    files = sorted(volume.rglob("sessions/*.sqlite"))
    with sqlite3.connect(f"file:{files[0]}?mode=ro", uri=True) as session:
        sound = session.execute("PRAGMA integrity_check").fetchone()[0]
        frames = session.execute("SELECT count(*) FROM frames").fetchone()[0]
    owner = files[0].stat().st_uid
    print(f"user id {user_id}; exit status {status} after SIGTERM")
    print(f"{stage.volume}/{files[0].relative_to(volume)}: {frames} rows of frames, integrity {sound}, owner {owner}")
    if frames == 0 or sound != "ok" or owner == 0:
        raise RuntimeError("the session is not as it should be")


def main() -> int:
    """Build the image's stages and check the service in the last one."""
    parser = argparse.ArgumentParser(description="Carry out the Dockerfile in chroots and check the service.")
    parser.add_argument("--folder", type=Path, default=Path("/var/tmp/voltwall-image"), help="where the stages go")
    parser.add_argument("--check", type=Path, metavar="STAGE.json", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.check is not None:
        check_service(Stage(**json.loads(args.check.read_text(encoding="utf-8"))))
        return 0
    args.folder.mkdir(parents=True, exist_ok=True)
    stage = build(args.folder)
    size = subprocess.run(["du", "-sm", f"{stage.root}/opt/voltwall"], capture_output=True, text=True, check=True)
    print(f"/opt/voltwall: {size.stdout.split()[0]} MB")
    description = args.folder / "stage.json"
    description.write_text(json.dumps(asdict(stage)), encoding="utf-8")
    inside = [
        "unshare",
        "--mount",
        "--net",
        "--kill-child",
        "--fork",
        sys.executable,
        __file__,
        "--check",
        str(description),
    ]
    return subprocess.run(inside, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
