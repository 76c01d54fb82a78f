"""What the service must not drag along."""

import subprocess
import sys


def test_the_service_starts_without_the_libraries_of_its_exports():
    code = (
        "import sys, app.api.application; "
        "print(*[m for m in ('pandas', 'pyarrow', 'asammdf', 'scipy', 'matplotlib') if m in sys.modules])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert found.stdout.split() == []
