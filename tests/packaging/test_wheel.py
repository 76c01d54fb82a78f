"""The wheel is the whole program: unpacked anywhere, it answers and serves its pages."""

import os
import re
import shutil
import signal
import subprocess
import sys
import urllib.request
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("app", "firmware_protocol", "simulator")
NOT_PACKED = shutil.ignore_patterns(
    "node_modules", "__pycache__", ".venv", "docs", "tests", "benchmarks", ".git", ".*_cache"
)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if not (ROOT / "app" / "static" / ".built-from").is_file():
        message = "the front end is not built: make frontend"
        pytest.fail(message) if os.environ.get("CI") == "true" else pytest.skip(message)
    folder = tmp_path_factory.mktemp("wheel")
    shutil.copytree(ROOT, folder / "source", ignore=NOT_PACKED)
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)],
        cwd=folder / "source",
        check=True,
        capture_output=True,
    )
    shutil.rmtree(folder / "source")
    return next(folder.glob("voltwall-*.whl"))


@pytest.fixture(scope="module")
def site(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder outside the checkout that holds the wheel's content."""
    folder = tmp_path_factory.mktemp("site")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    return folder


def environment(site: Path) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(site), "PYTHONUNBUFFERED": "1"}


def test_the_wheel_holds_the_pages_and_every_data_file(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        packed = set(archive.namelist())
    data = [
        file.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for file in (ROOT / package).rglob("*")
        if file.suffix in {".sql", ".json", ".toml", ".csv", ".html", ".js", ".css", ".woff2"}
    ]
    assert any(name.startswith("app/static/") and name.endswith(".js") for name in data)
    assert [name for name in data if name not in packed] == []
    assert "app/static/index.html" in packed


def test_the_wheel_holds_nothing_else(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        top = {name.split("/")[0] for name in archive.namelist()}
    assert {name for name in top if not name.endswith(".dist-info")} == set(PACKAGES)


def test_the_unpacked_wheel_tells_its_version(wheel: Path, site: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "app.cli", "--version"]
    answer = subprocess.run(command, cwd=tmp_path, env=environment(site), capture_output=True, text=True, check=True)
    assert answer.stdout.split() == ["voltwall", wheel.name.split("-")[1]]


def test_the_unpacked_wheel_serves_its_pages(site: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "app.cli", "serve", "--port", "0", "--data", str(tmp_path / "data")]
    with subprocess.Popen(
        command, cwd=tmp_path, env=environment(site), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as service:
        try:
            address = next(match[1] for line in service.stdout if (match := re.search(r"Voltwall: (http://\S+)", line)))
            with urllib.request.urlopen(address + "/", timeout=10) as answer:
                page = answer.read().decode()
            script = re.search(r'<script[^>]+src="([^"]+)"', page)[1]
            with urllib.request.urlopen(f"{address}/{script.lstrip('./')}", timeout=10) as answer:
                assert "javascript" in answer.headers["Content-Type"]
        finally:
            service.send_signal(signal.SIGTERM)
            service.communicate(timeout=20)
