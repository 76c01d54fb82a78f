"""The simulated accumulator: physics, the firmware as its master, ports that look like the real thing."""

import os

# Read when numpy is first imported: on a busy core, two threads make matrices of 140 rows a hundred times slower.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
