"""Commands of `voltwall` in this process, simulators in others; that both are programs, a few tests show."""

import subprocess
from collections.abc import Callable, Iterator

import pytest

from app.cli import main
from tests.simulator_port import Simulator, simulators


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


@pytest.fixture
def simulator() -> Iterator[Callable[..., Simulator]]:
    """Start simulators."""
    with simulators() as start:
        yield start
