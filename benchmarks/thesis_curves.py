"""The curves that the SOC thesis (SPKF-2020) uses as OCV: terminal voltages under load, read off a data sheet."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

# Terminal voltage at 1C and 10C over the charge drawn, 22 points over 25 Ah [V].
AT_1C = np.array(
    [4.15, 4.03, 3.98, 3.945, 3.89, 3.84, 3.79, 3.745, 3.695, 3.65, 3.61,
     3.575, 3.55, 3.51, 3.48, 3.45, 3.41, 3.35, 3.28, 3.08, 2.75, 2.5]
)  # fmt: skip
AT_10C = np.array(
    [4.15, 3.48, 3.435, 3.385, 3.35, 3.32, 3.29, 3.27, 3.24, 3.215, 3.185,
     3.16, 3.13, 3.11, 3.08, 3.05, 3.01, 2.95, 2.875, 2.73, 2.5, 2.5]
)  # fmt: skip


def load_curves() -> FloatArray:
    """Return (10, 1001) terminal voltage [V] at 1C..10C over SOC 0..1: the curves that the thesis uses as OCV."""
    drawn = np.linspace(0.0, 1.0, 22)
    soc = np.linspace(0.0, 1.0, 1001)
    low, high = np.interp(1.0 - soc, drawn, AT_1C), np.interp(1.0 - soc, drawn, AT_10C)
    return np.linspace(low, high, 10)
