"""The check of commit subjects: what it takes, and that it asks nothing of a history that is not here."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / ".ci" / "commit_subject.py"


def loaded():
    spec = importlib.util.spec_from_file_location("commit_subject", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("subject", "is_good"),
    [
        ("engine: read the OCV at a SOC of the surface", True),
        ("Merge branch 'x'", True),
        ("Read the OCV", False),
        ("engine: read it.", False),
        ("engine:", False),
        ("engine: " + 52 * "x", True),
        ("engine: " + 53 * "x", False),
    ],
)
def test_a_subject_is_an_area_and_what_is_done(subject, is_good):
    assert (loaded().problem(subject) is None) == is_good


@pytest.fixture
def repository(tmp_path):
    """A repository in which a wrong subject came before the check was added."""

    def git(*arguments):
        who = ("-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false")
        subprocess.run(["git", "-C", str(tmp_path), *who, *arguments], check=True, capture_output=True)

    git("init", "-q")
    git("commit", "-q", "--allow-empty", "-m", "Anything at all")
    (tmp_path / ".ci").mkdir()
    (tmp_path / ".ci" / SCRIPT.name).write_bytes(SCRIPT.read_bytes())
    git("add", ".")
    git("commit", "-q", "-m", "ci: check subjects")
    return tmp_path, git


def check(folder, *arguments):
    command = [sys.executable, str(folder / ".ci" / SCRIPT.name), *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True)


def test_only_commits_after_the_check_are_checked(repository):
    folder, git = repository
    assert check(folder, "--since").returncode == 0
    git("commit", "-q", "--allow-empty", "-m", "Tell something")
    done = check(folder, "--since")
    assert (done.returncode, "Tell something" in done.stderr) == (1, True)


def test_without_history_nothing_is_wrong(repository, tmp_path_factory):
    folder, git = repository
    git("commit", "-q", "--allow-empty", "-m", "Tell something")
    shallow = tmp_path_factory.mktemp("shallow") / "copy"
    subprocess.run(["git", "clone", "-q", "--depth", "1", f"file://{folder}", str(shallow)], check=True)
    assert check(shallow, "--since").returncode == 0
    bare = tmp_path_factory.mktemp("bare")
    (bare / ".ci").mkdir()
    (bare / ".ci" / SCRIPT.name).write_bytes(SCRIPT.read_bytes())
    assert check(bare, "--since").returncode == 0


def test_the_hook_refuses_a_wrong_subject_and_replaces_no_other_hook(repository):
    folder, git = repository
    assert check(folder, "--install").returncode == 0
    git("commit", "-q", "--allow-empty", "-m", "ci: add nothing")
    with pytest.raises(subprocess.CalledProcessError):
        git("commit", "-q", "--allow-empty", "-m", "Add nothing")
    hook = folder / ".git" / "hooks" / "commit-msg"
    hook.write_text("#!/bin/sh\nexit 0\n")
    check(folder, "--install")
    assert hook.read_text() == "#!/bin/sh\nexit 0\n"
