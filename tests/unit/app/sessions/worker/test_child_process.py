"""What a process of ours runs does not depend on the folder in which it is started."""

import subprocess
from pathlib import Path

from app.sessions.worker.child_process import command_of


def test_a_file_in_the_working_folder_is_not_run_in_place_of_a_library(tmp_path: Path) -> None:
    for name in ("can.py", "serial.py", "app.py", "simulator.py"):
        (tmp_path / name).write_text("raise SystemExit('run from the working folder')")
    done = subprocess.run(
        command_of("simulator.cli", "--help"), cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "--scenario" in done.stdout


def test_arguments_arrive_as_they_are(tmp_path: Path) -> None:
    command = command_of("simulator.cli", "--scenario", "no such scenario")
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "no such scenario" in done.stderr
