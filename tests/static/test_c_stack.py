"""The stack that the C reference needs on a chip, by gcc's own figures."""

import re
import subprocess
import sys
from pathlib import Path

from tests.c_programs import require_gcc

COST = Path(__file__).parents[2] / "benchmarks" / "firmware" / "cost.py"


def test_the_worst_case_stack_is_known_and_small():
    """Summed over gcc's call graph: no recursion, no alloca, and less than a quarter of the smallest usual stack."""
    require_gcc()
    done = subprocess.run([sys.executable, COST, "--cc", "gcc"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    stacks = dict(re.findall(r"-Os stack (\w+): (\d+) bytes", done.stdout))
    assert stacks.keys() == {
        *("vw_link_init", "vw_link_received", "vw_link_run", "vw_link_next", "vw_can_next", "vw_can_received"),
        *("vw_slaves_start", "vw_slaves_read_voltages", "vw_slaves_read_temperatures", "vw_slaves_self_check"),
        *("vw_measuring_add_samples", "vw_measuring_run"),
        *("vw_master_init", "vw_master_step", "vw_master_command"),
        *("vw_filter_start", "vw_filter_step"),
    }
    assert max(map(int, stacks.values())) < 1024
