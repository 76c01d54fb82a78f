"""A season of two sessions: laps of a minute, cell 40 lower than the others, cell 7 with more resistance."""

from pathlib import Path

import numpy as np

from app.season.lake.build import build_lake, session_files
from app.season.lake.place import LakeFolder
from tests.recorded.arrays import START_S, SessionMaker

LAP_S = 60.0
DAY_S = 86_400.0
TIME_S = np.arange(0.0, 3 * LAP_S + 2.0, 0.5)
CURRENT_A = np.where(np.sin(2 * np.pi * TIME_S / 7.0) > 0, 100.0, -20.0)
R_OHM = np.full(96, 0.002)
R_OHM[7] = 0.003
OCV_V = np.full(96, 3.8)
OCV_V[40] = 3.6


def record(make: SessionMaker, start_s: float, soc_from: float, **more) -> Path:
    volts = OCV_V - CURRENT_A[:, None] * R_OHM
    heat = np.tile(20 + np.floor(TIME_S / LAP_S)[:, None], (1, 96))
    marks = [(k * LAP_S + 1, "lap", "") for k in range(4)]
    events = [
        {"at_s": 70.0, "severity": "warning", "code": "finding-joint", "text": "joint", "cell": 7},
        {"at_s": 5.0, "severity": "info", "code": "note", "text": "begin"},
    ]
    soc = soc_from - 0.03 * TIME_S / LAP_S
    return make(TIME_S, CURRENT_A, volts, heat, soc, markers=marks, events=events, start_s=start_s, **more)


def make_season(folder: Path) -> Path:
    """Record the two sessions, the second of a simulated car; return their folder."""
    make = SessionMaker(folder)
    record(make, START_S, 0.9)
    record(make, START_S + DAY_S, 0.8, metadata={"source": "simulator", "car": "E 26", "season": "autumn"})
    return folder


def make_lake(sessions: Path) -> Path:
    """Make their lake beside them and return its folder."""
    folder = sessions.parent / "lake"
    assert len(build_lake(LakeFolder(folder), session_files([sessions])).made) == 2
    return folder
