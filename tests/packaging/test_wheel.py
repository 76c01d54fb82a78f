"""The wheel is the whole program, and takes no name but `voltwall`: unpacked anywhere, it answers and serves pages."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
import urllib.request
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hatch_build import INSIDE, LIBRARIES, TARGETS, Library, compile_library, imports_inside, sources_digest
from tests.recorded.arrays import SessionMaker

pytestmark = pytest.mark.timeout(900)  # it builds
ROOT = Path(__file__).resolve().parents[2]
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


def recorded(address: str) -> dict[str, Any]:
    """Return the session that is being recorded, once there is something in it."""
    until = time.monotonic() + 60
    while time.monotonic() < until:
        with urllib.request.urlopen(address, timeout=10) as answer:
            for session in json.load(answer)["sessions"]:
                if session["frames"] > 20:
                    return session
        time.sleep(0.2)
    raise TimeoutError("nothing was recorded")


def environment(site: Path) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(site), "PYTHONUNBUFFERED": "1"}


def test_the_wheel_holds_its_bill_of_materials(site: Path) -> None:
    [made] = site.glob("voltwall-*.dist-info/sboms/*.cdx.json")
    assert made.read_bytes() == (ROOT / "requirements" / "voltwall.cdx.json").read_bytes()


def test_the_wheel_holds_the_pages_and_every_data_file(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        packed = set(archive.namelist())
    data = [
        f"voltwall/{file.relative_to(ROOT).as_posix()}"
        for package in INSIDE
        for file in (ROOT / package).rglob("*")
        if file.suffix in {".sql", ".json", ".toml", ".csv", ".html", ".js", ".css", ".woff2"}
    ]
    assert any(name.startswith("voltwall/app/static/") and name.endswith(".js") for name in data)
    assert [name for name in data if name not in packed] == []
    assert "voltwall/app/static/index.html" in packed
    assert "voltwall/py.typed" in packed


def test_the_wheel_holds_nothing_else(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        top = {name.split("/")[0] for name in archive.namelist()}
    assert {name for name in top if not name.endswith(".dist-info")} == {"voltwall"}


def test_what_a_module_imports_of_ours_is_inside_voltwall() -> None:
    source = (
        '"""from app import nothing."""\n'
        "from app.errors import AppError\n"
        "from apparatus import dial\n"
        "if True:\n"
        "    from simulator import (\n        cli,\n    )\n"
        "from .near import thing\n"
        "import numpy as np  # not app\n"
        "from firmware_protocol import messages; from app import words\n"
    )
    assert imports_inside(source) == (
        source.replace("\nfrom app.errors", "\nfrom voltwall.app.errors")
        .replace("from simulator", "from voltwall.simulator")
        .replace("from firmware_protocol", "from voltwall.firmware_protocol")
        .replace("; from app", "; from voltwall.app")
    )
    with pytest.raises(SyntaxError, match=r"line 2: write `from app import x`"):
        imports_inside("import numpy\nimport app.words\n")


@pytest.fixture
def of_the_user(tmp_path: Path) -> Path:
    """A folder with modules of the user that are called as packages of ours."""
    for name in INSIDE:
        (tmp_path / f"{name}.py").write_text(f"MINE = {name!r}\n")
    return tmp_path


def test_a_program_keeps_modules_of_its_own_called_app_and_simulator(site: Path, of_the_user: Path) -> None:
    time_s = np.arange(0.0, 20.0, 0.1)
    session = SessionMaker(of_the_user / "sessions")(time_s, 40 * np.sin(time_s), 3.7, 25, 0.8)
    program = of_the_user / "strategy.py"
    program.write_text(
        "import app, simulator, voltwall, firmware_protocol\n"
        f"with voltwall.open({str(session)!r}) as session:\n"
        "    print(app.MINE, simulator.MINE, firmware_protocol.MINE, len(session.table('v').rows()))\n"
    )
    command = [sys.executable, str(program)]
    done = subprocess.run(command, cwd=of_the_user, env=environment(site), capture_output=True, text=True, check=True)
    *mine, rows = done.stdout.split()
    assert mine == ["app", "simulator", "firmware_protocol"]
    assert int(rows) > 100


def test_the_wheel_is_for_this_platform_and_for_every_python(wheel: Path) -> None:
    assert re.fullmatch(r"voltwall-[^-]+-py3-none-(?!any)\w+\.whl", wheel.name)
    with zipfile.ZipFile(wheel) as archive:
        about = archive.read(next(name for name in archive.namelist() if name.endswith(".dist-info/WHEEL"))).decode()
    assert "Root-Is-Purelib: false" in about


def test_a_clean_environment_has_the_c_engine(wheel: Path, tmp_path: Path) -> None:
    folder = tmp_path / "venv"
    subprocess.run([sys.executable, "-m", "venv", "--system-site-packages", str(folder)], check=True)
    python = folder / "bin" / "python"
    install = [str(python), "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--force-reinstall"]
    subprocess.run([*install, str(wheel)], check=True)
    code = (
        "from voltwall.app.estimation.filters.engine import library; library.load(); "
        "from voltwall.simulator import firmware; firmware.load(); "
        "from voltwall.app.estimation.cell_model.cell_file import load_cell; "
        "from voltwall.app.estimation.filters.estimators import make_estimator; "
        "print(library.LIBRARY); print(type(make_estimator('fused', load_cell(), 2).engine).__name__)"
    )
    answer = subprocess.run([str(python), "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    library, engine = answer.stdout.split()
    assert Path(library).is_relative_to(folder)
    assert engine == "NativeEngine"


HEADERS = {
    "linux-x86_64": (b"\x7fELF\x02\x01", 18, b"\x3e\x00"),
    "linux-aarch64": (b"\x7fELF\x02\x01", 18, b"\xb7\x00"),
    "macos-x86_64": (b"\xcf\xfa\xed\xfe", 4, b"\x07\x00\x00\x01"),
    "macos-arm64": (b"\xcf\xfa\xed\xfe", 4, b"\x0c\x00\x00\x01"),
    "windows-x86_64": (b"MZ", None, b"PE\x00\x00\x64\x86"),
}  # how a library begins, where the processor is named, and its name


@pytest.mark.parametrize("library", LIBRARIES, ids=lambda library: library.stem)
@pytest.mark.parametrize("name", TARGETS)
def test_the_libraries_are_built_for_other_platforms(name: str, library: Library, tmp_path: Path) -> None:
    pytest.importorskip("ziglang")
    target = TARGETS[name]
    content = compile_library(ROOT, library, tmp_path, target)[0].read_bytes()
    magic, at, machine = HEADERS[name]
    at = int.from_bytes(content[0x3C:0x40], "little") if at is None else at
    assert content.startswith(magic)
    assert content[at : at + len(machine)] == machine
    assert sources_digest(ROOT, library).encode() in content


def test_the_unpacked_wheel_tells_its_version(wheel: Path, site: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "voltwall", "--version"]
    answer = subprocess.run(command, cwd=tmp_path, env=environment(site), capture_output=True, text=True, check=True)
    assert answer.stdout.split() == ["voltwall", wheel.name.split("-")[1]]


def test_the_unpacked_wheel_serves_its_pages_and_a_report(site: Path, of_the_user: Path) -> None:
    """With the simulated car and a worker, which are processes of their own, beside the user's `app.py`."""
    command = [sys.executable, "-m", "voltwall", "serve", "--port", "0", "--data", str(of_the_user / "data")]
    with subprocess.Popen(
        command, cwd=of_the_user, env=environment(site), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as service:
        try:
            address = next(match[1] for line in service.stdout if (match := re.search(r"Voltwall: (http://\S+)", line)))
            with urllib.request.urlopen(address + "/", timeout=10) as answer:
                page = answer.read().decode()
            script = re.search(r'<script[^>]+src="([^"]+)"', page)[1]
            with urllib.request.urlopen(f"{address}/{script.lstrip('./')}", timeout=10) as answer:
                assert "javascript" in answer.headers["Content-Type"]
            session = recorded(f"{address}/api/v1/sessions")
            with urllib.request.urlopen(f"{address}/api/v1/sessions/{session['id']}/report", timeout=60) as answer:
                assert json.load(answer)["session"]["simulated"] is True
        finally:
            service.send_signal(signal.SIGTERM)
            service.communicate(timeout=20)
