"""Bytecode of the product and of the tests, written before the test processes start.

pytest rewrites every `assert` of a test file when it imports it, which takes twice as long as the rest of a collection.
Each process of a run would do that by itself, all at the same time, where no earlier run has left the bytecode, and
again in every run where the environment forbids to keep it.
"""

import os
import subprocess
import sys

import pytest

REWRITTEN = "__pycache__/test_*-pytest-*.pyc"
ENOUGH = 0.5  # share of the test files: few change from run to run


def write_bytecode(config: pytest.Config) -> None:
    """Let all processes keep their bytecode, and before a run of everything in an empty clone write that of the tests.

    The first folder is as large as the others together: two processes share the work.
    """
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    if not getattr(config.option, "tx", None) or config.args_source is not pytest.Config.ArgsSource.TESTPATHS:
        return
    tests = config.rootpath / "tests"
    if len([*tests.rglob(REWRITTEN)]) >= ENOUGH * len([*tests.rglob("test_*.py")]):
        return
    collect = [sys.executable, "-m", "pytest", "-n", "0", "--collect-only", "-qq", "-p", "no:cacheprovider"]
    running = [
        subprocess.Popen([*collect, *folders], cwd=config.rootpath, stdout=subprocess.DEVNULL)
        for folders in (config.args[:1], config.args[1:])
    ]
    for process in running:
        process.wait()  # a file that cannot be collected: the run itself says so
