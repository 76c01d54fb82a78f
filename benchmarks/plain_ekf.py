"""The judge: the extended Kalman filter of a textbook on the same cell file, for two RC pairs, nothing added.

States are SOC and the currents through the RC resistors; white noise on voltage and current, one tuning for all cells.
Source: Plett, J. Power Sources 134 (2004) 277. It shares the cell file with the product and not a line of its filters.
"""

from __future__ import annotations

import ctypes
import subprocess
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import ArrayLike, NDArray

from app.estimation.cell_model.circuit import CellModel
from hatch_build import compiler

FloatArray = NDArray[np.float64]

VOLTAGE_SIGMA_V = 0.01  # of model and sensor, white
CURRENT_SIGMA_C = 0.02  # likewise
SOC_SIGMA = 0.1  # of the start
POINTS = 1001  # of the cell file over SOC, as in plain_ekf.c
N_RC = 2
SOC_WALK = 3e-6  # per square root of a second


def plain_ekf(
    cell: CellModel, dt_s: FloatArray, current_a: FloatArray, voltage_v: FloatArray, degc: FloatArray, soc: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Return (n_steps, n) SOC and sigma of n runs side by side.

    Args:
        cell: the cell model; its hysteresis and time constants over SOC are left out.
        dt_s: (n_steps,) time since the sample before [s].
        current_a: (n_steps, n) positive on discharge [A].
        voltage_v: (n_steps, n) [V].
        degc: (n_steps, n) [degC].
        soc: (n,) or scalar, at the first sample.
    """
    if cell.n_rc != N_RC:
        raise ValueError(f"this filter is for {N_RC} RC pairs, not for {cell.n_rc}")
    n_steps, n = voltage_v.shape
    table, tau_s = _table(cell)
    grid_degc = np.asarray(cell.temperature_grid_degc, np.float64)
    noise = np.array([VOLTAGE_SIGMA_V**2, (CURRENT_SIGMA_C * cell.capacity_ah) ** 2, SOC_WALK**2])
    samples = [np.ascontiguousarray(each, np.float64) for each in (dt_s, current_a, voltage_v, degc, table)]
    first = np.ascontiguousarray(np.broadcast_to(soc, (n,)), np.float64)
    found = np.empty((2, n_steps, n))
    at = [ctypes.c_void_p(each.ctypes.data) for each in (*samples, grid_degc, tau_s, noise, first, *found)]
    real = ctypes.c_double
    _library().plain_ekf(
        *(ctypes.c_int64(n_steps), ctypes.c_int32(n), *at[:5], ctypes.c_int32(grid_degc.size), *at[5:7]),
        *(real(cell.capacity_ah), real(cell.overpotential_current_a), at[7], real(SOC_SIGMA), *at[8:]),
    )
    return found[0], found[1]


@cache
def _library() -> ctypes.CDLL:
    """Return the filter, compiled for this machine."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "plain_ekf.so")
        source = Path(__file__).with_suffix(".c")
        command = [*compiler(None), "-std=c99", "-O2", "-fPIC", "-shared", str(source), "-o", str(path), "-lm"]
        subprocess.run(command, check=True)
        return ctypes.CDLL(str(path))


def _table(cell: CellModel) -> tuple[FloatArray, FloatArray]:
    """Return (n_temperatures, POINTS, 4 + n_rc) OCV, slope, R0, overpotential, RC resistances; (n_rc,) taus."""
    soc, n = np.linspace(0.0, 1.0, POINTS), 2 + cell.n_rc
    rows = []
    for degc in cell.temperature_grid_degc:
        circuit = cell.parameters(soc, np.full(POINTS, degc))[:n]
        rows.append(np.array((cell.ocv.voltage(soc), cell.ocv.slope(soc), *circuit)).T)
    return np.array(rows), np.asarray(cell.parameters(0.5, 25.0)[n:])
