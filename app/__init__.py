"""The program: links, shadow image, pipeline, sessions, API, command line."""

import os

# Read when numpy is first imported: the arrays are small, and a second thread that has to wait for a busy core delays
# a filter step a hundredfold.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

__version__ = "1.0.0"
