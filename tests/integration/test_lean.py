"""What the service and its simulated car must not drag along."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize("program", ["app.api.application", "simulator.scenario_player, simulator.control_server"])
def test_it_starts_without_the_libraries_of_exports(program):
    code = (
        f"import sys, {program}; "
        "print(*[m for m in ('pandas', 'pyarrow', 'asammdf', 'scipy', 'matplotlib') if m in sys.modules])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert found.stdout.split() == []
