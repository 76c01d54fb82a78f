"""Loggers that write the mean current of a step with the voltage of the instant at its end.

The drop of such a voltage belongs half to the mean before it and half to the one after:

    -dv_k = R (a di_k-1 + b di_k + c di_k+1)        c / (a + b + c): 0 of instants, 1/2 of means

The mean of two neighbouring voltages belongs to the current between them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from app.estimation.arrays import BoolArray, FloatArray
from app.estimation.recording.cell_recording import GAP_STEPS, Recording

STEP_MIN_S: Final = 0.5  # what is written faster is no mean that matters
CHANGES_MIN: Final = 100  # changes of the current from which the shares are read
NEXT_SHARE: Final = (0.25, 0.75)  # 0.41 to 0.49 of six drives written as means, -0.03 to 0.06 as instants
EXPLAINED_MIN: Final = 0.3  # share of the changes of the voltage; below it they have no information


def takes_means(choice: str, recording: Recording) -> bool:
    """Return whether voltages are to be taken as means: as one of `CHOICES` says, or the data."""
    return has_current_means(recording) if choice == "auto" else choice == "yes"


def has_current_means(recording: Recording) -> bool:
    """Return whether the currents look like means of their steps, and the voltages like instants."""
    if recording.usual_step_s < STEP_MIN_S:
        return False
    voltage, current = np.diff(recording.voltage_v), np.diff(recording.current_a)
    measured, by = -voltage[1:-1], np.column_stack((current[:-2], current[1:-1], current[2:]))
    is_even = np.abs(np.diff(recording.time_s) / recording.usual_step_s - 1.0) < 0.5
    used = np.isfinite(measured) & by.any(axis=1) & is_even[:-2] & is_even[1:-1] & is_even[2:]
    if np.count_nonzero(used) < CHANGES_MIN:
        return False
    measured, by = measured[used], by[used]
    share = np.linalg.lstsq(by, measured, rcond=None)[0]
    left = measured - by @ share
    is_explained = float(left @ left) < (1.0 - EXPLAINED_MIN) * float(measured @ measured)
    low, high = NEXT_SHARE
    return is_explained and bool(low * share.sum() < share[2] < high * share.sum())


def step_means(before_v: FloatArray, voltage_v: FloatArray, follows: BoolArray | bool) -> FloatArray:
    """Return each voltage as the mean of the one before and its own, where it follows one that was measured [V]."""
    return np.where(np.isfinite(before_v) & follows, 0.5 * (before_v + voltage_v), voltage_v)


def with_voltage_means(recording: Recording) -> Recording:
    """Return the recording with each voltage the mean of the one before and its own, but over gaps."""
    v = recording.voltage_v
    follows = recording.step_s <= GAP_STEPS * recording.usual_step_s
    means_v = step_means(np.concatenate((v[:1], v[:-1])), v, follows)
    note = "currents are means of their steps: each voltage is taken as the mean of its step too"
    return replace(recording, voltage_v=means_v, notes=(*recording.notes, note))
