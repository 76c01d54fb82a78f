"""Commands of `voltwall` in this process; that the program itself starts and ends as it should, a few tests show."""

import subprocess
from collections.abc import Callable

import pytest

from app.cli import main


@pytest.fixture
def voltwall(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Callable[..., object]:
    """Run a command: its words, and environment variables by keyword."""

    def run(*words: str, **environment: str) -> subprocess.CompletedProcess[str]:
        capsys.readouterr()
        with monkeypatch.context() as patch:
            for name, value in environment.items():
                patch.setenv(name, value)
            try:
                code = main(words)
            except SystemExit as ended:  # argparse
                code = int(ended.code or 0)
        return subprocess.CompletedProcess(words, code, *capsys.readouterr())

    return run
