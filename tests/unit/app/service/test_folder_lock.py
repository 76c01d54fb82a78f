import subprocess
import sys
from pathlib import Path

import pytest

from app.errors import ConfigError
from app.service.host import locked_folder

HOLD = """
import sys
from pathlib import Path
from app.service.host import locked_folder
with locked_folder(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_a_second_service_is_refused_until_the_first_has_ended(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "data"
    with locked_folder(folder), pytest.raises(ConfigError, match="in use by another voltwall"), locked_folder(folder):
        pass
    with locked_folder(folder):
        assert folder.is_dir()


def test_a_service_that_was_killed_leaves_no_lock(tmp_path: Path) -> None:
    command = [sys.executable, "-c", HOLD, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout.readline() == b"held\n"
        with pytest.raises(ConfigError, match="in use by another voltwall"), locked_folder(tmp_path):
            pass
        holder.kill()
        holder.wait()
    with locked_folder(tmp_path):
        pass


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match=r"Not a directory|exists"), locked_folder(tmp_path / "file" / "data"):
        pass


def test_an_error_inside_is_not_taken_for_the_folders(tmp_path: Path) -> None:
    with pytest.raises(PermissionError), locked_folder(tmp_path):
        raise PermissionError
