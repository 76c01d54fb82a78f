"""The commands of `voltwall`, run as a user runs them."""

import json
import subprocess
import sys

import cantools
import pytest
from websockets.sync.client import connect

from app.cli import COMMANDS
from tests.forked import start_program


def as_a_process(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "app.cli", *words], capture_output=True, text=True, check=False)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(voltwall, command):
    result = voltwall(command, "--help")
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith(f"usage: voltwall {command}")


def test_version_and_a_wrong_command():
    assert as_a_process("--version").stdout.startswith("voltwall ")
    wrong = as_a_process("fly")
    assert wrong.returncode == 2
    assert "unknown 'fly'" in wrong.stderr


def test_config_without_a_service_is_one_line():
    result = as_a_process("config", "--url", "http://127.0.0.1:9", "read")
    assert result.returncode == 3
    assert "no voltwall service answers" in result.stderr
    assert len(result.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["serve", "--serial", ""], "serial"),
        (["serve", "--serial", "bogus://x"], "serial"),
        (["serve", "--serial", "socket://127.0.0.1"], "serial"),
        (["serve", "--serial", "socket://127.0.0.1:99999"], "serial"),
        (["serve", "--can", "zz:0"], "socketcan"),
        (["replay", "x.sqlite", "--speed", "0"], "0.1 to 100"),
        (["replay", "x.sqlite", "--speed", "nan"], "0.1 to 100"),
        (["dbc", "--out", "/nowhere/x.dbc"], "out"),
        (["config", "--url", "bogus", "read"], "http://"),
        (["config", "read", "--url", "bogus"], "http://"),
        (["bench", "--cell", "zz"], "cell"),
        (["bench", "--seconds", "-1"], "seconds"),
    ],
)
def test_what_cannot_work_is_one_line_that_names_it(voltwall, words, named, tmp_path):
    result = voltwall(*words, VOLTWALL_DATA=str(tmp_path), VOLTWALL_PORT="0")
    assert result.returncode == 2
    assert named in result.stderr.splitlines()[-1]
    assert "Traceback" not in result.stderr


def test_dbc_opens_in_cantools(voltwall, tmp_path):
    path = tmp_path / "voltwall.dbc"
    assert voltwall("dbc", "--out", str(path)).returncode == 0
    database = cantools.database.load_file(path)
    decoded = database.decode_message(0x100, bytes.fromhex("1027c08a") + (-250).to_bytes(4, "little", signed=True))
    assert decoded["soc"] == pytest.approx(1.0)
    assert decoded["i_fs"] == pytest.approx(-2.5)


def test_replay_gives_the_same_snapshots_again(voltwall, make_service):
    service = make_service()
    seen = {}
    service.wait_for(lambda s: s["recording"])
    with connect(service.base_url.replace("http", "ws") + "/api/v1/live", max_size=1 << 22) as socket:
        while len(seen) < 25:
            snapshot = json.loads(socket.recv(timeout=20))
            seen.setdefault(snapshot["uptime_s"], snapshot)
    service.stop()
    path = next((service.data / "sessions").glob("*.sqlite"))
    result = voltwall("replay", str(path), "--json")
    assert result.returncode == 0, result.stderr
    replayed: dict = {}
    for line in result.stdout.splitlines():
        snapshot = json.loads(line)
        replayed.setdefault(snapshot["uptime_s"], snapshot)
    common = [uptime for uptime in seen if uptime in replayed]
    assert len(common) > 15
    for uptime in common:
        for part in ("cells", "packs", "charger"):
            assert replayed[uptime][part] == seen[uptime][part], (uptime, part)
        for name in ("voltage_v", "current_a", "soc", "driver_soc_percent", "energy_out_wh"):
            assert replayed[uptime]["accumulator"][name] == seen[uptime]["accumulator"][name], (uptime, name)


def test_replay_serves_a_file_in_the_browser(make_service, tmp_path):
    service = make_service()
    service.wait_for(lambda s: s["recording"] and s["recording"]["frames"] > 20)
    service.stop()
    path = next((service.data / "sessions").glob("*.sqlite"))
    process, output = start_program("app.cli", ["replay", str(path), "--port", "0"])
    try:
        url = next(line for line in output if "Voltwall: " in line).split()[-1]
        with connect(url.replace("http", "ws") + "/api/v1/live", max_size=1 << 22) as socket:
            snapshot = json.loads(socket.recv(timeout=40))
            while snapshot["accumulator"]["loaded_cells"] != 96:
                snapshot = json.loads(socket.recv(timeout=40))
        assert snapshot["source"] == "replay"
        assert snapshot["replay"]["session_id"] == path.stem
    finally:
        process.terminate()
        process.join(15)
        output.close()


def test_replay_of_something_else_is_one_line(voltwall, tmp_path):
    path = tmp_path / "not-a-session.sqlite"
    path.write_text("hello")
    for arguments in ((str(path), "--json"), (str(tmp_path / "missing"),), (str(path),)):
        result = voltwall("replay", *arguments)
        assert result.returncode == 2
        assert len(result.stderr.splitlines()) == 1
