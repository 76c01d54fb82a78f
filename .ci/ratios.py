"""Lines of tests for a line of code, at least one: run by `make check`.

Lines of tests: the package's folder in tests/unit, and each file of tests/property and tests/numeric that imports more
names from this package than from any other of ours. Blank lines, docstrings and lines of comment count on neither side:
what explains an array's shape needs no test.
"""

from __future__ import annotations

import ast
import sys
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
AIM = 1.0
PACKAGES = ("app/estimation", "firmware_protocol", "app/sources")
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
SHARED = ("tests/property", "tests/numeric")


def lines_of(path: Path) -> int:
    """Return the lines of code in a file."""
    source = path.read_text(encoding="utf-8")
    explained: set[int] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node) is not None:
            explained.update(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
    lines = enumerate(source.splitlines(), 1)
    return sum(bool(line.strip()) and not line.lstrip().startswith("#") for n, line in lines if n not in explained)


def package_of(test: Path) -> str | None:
    """Return the folder that a test imports most names from: `app/estimation`, `simulator`."""
    found: Counter[str] = Counter()
    for node in ast.walk(ast.parse(test.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            parts = node.module.split(".")
            found["/".join(parts[:2]) if parts[0] == "app" else parts[0]] += len(node.names)
    ours = [(count, package) for package, count in found.items() if (ROOT / package).is_dir() and package != "tests"]
    return max(ours)[1] if ours else None


def main() -> int:
    """Print each package's ratio; 1 where one is below the aim."""
    shared = {test: package_of(test) for folder in SHARED for test in sorted((ROOT / folder).glob("test_*.py"))}
    status = 0
    for package in PACKAGES:
        code = sum(map(lines_of, (ROOT / package).rglob("*.py")))
        own = sum(map(lines_of, (ROOT / "tests/unit" / package).rglob("test_*.py")))
        other = sum(lines_of(test) for test, belongs in shared.items() if belongs == package)
        ratio = (own + other) / code
        tests = f"tests {own:5} unit + {other:5} property and numeric"
        print(f"{package:18} {code:5} lines, {tests}: {ratio:.2f} of {AIM:.1f}")
        if ratio < AIM:
            print(f"{package}: fewer than {AIM:.0f} lines of tests for a line of code")
            status = 1
    return status


if __name__ == "__main__":
    sys.exit(main())
