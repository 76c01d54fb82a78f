"""A snapshot as JSON: one function, used by REST and by the websocket, so that both say the same."""

from dataclasses import asdict
from typing import Any

import numpy as np
import orjson

from app.telemetry import Alarm, FloatArray, Snapshot

_OPTIONS = orjson.OPT_SERIALIZE_NUMPY
_UNKNOWN: dict[str, dict[str, None]] = {"can": {"crc_errors": None, "resyncs": None}}  # its controller sorts them out
_DECIMALS = {
    "voltage_v": 4,
    "temperature_degc": 1,
    "soc": 5,
    "soc_sigma": 5,
    "ocv_v": 4,
    "residual_v": 4,
    "resistance_ohm": 6,
    "capacity_ah": 3,
    "soh_capacity": 4,
    "resistance_factor": 3,
    "joint_excess_ohm": 6,
}


def _rounded(values: FloatArray, decimals: int) -> FloatArray:
    """Shorter text; NaN becomes null in orjson."""
    return np.round(values, decimals)


def _number(value: Any) -> Any:
    return round(value, 6) if isinstance(value, float) else value


def _numbers(values: dict[str, Any]) -> dict[str, Any]:
    return {name: _number(value) for name, value in values.items()}


def alarm_json(alarm: Alarm) -> dict[str, Any]:
    """One alarm."""
    body = _numbers(asdict(alarm))
    body["since"] = body.pop("since_ns") / 1e9
    return body


def snapshot_json(snapshot: Snapshot, service: dict[str, Any]) -> bytes:
    """Encode a snapshot; `service` is merged in (recording, last_event_id, config_stored_hash, replay)."""
    cells = snapshot.cells
    n = len(cells.voltage_v)
    per_cell: dict[str, Any] = {name: _rounded(getattr(cells, name), decimals) for name, decimals in _DECIMALS.items()}
    per_cell["balancing"] = [None] * n if cells.balancing is None else cells.balancing
    per_cell["joint_loose"] = [None] * n if cells.joint_loose is None else cells.joint_loose
    per_cell["model_valid"] = [None] * n if cells.model_valid is None else cells.model_valid
    body = {
        "seq": snapshot.sequence,
        "time": snapshot.t_wall_ns / 1e9,
        "uptime_s": snapshot.uptime_s,
        "source": snapshot.source,
        "age": _numbers(snapshot.age_s),
        "cells": per_cell,
        "packs": [_numbers(pack) for pack in snapshot.packs],
        "accumulator": _numbers(snapshot.accumulator),
        "prediction": snapshot.prediction,
        "master": snapshot.master,
        "charger": _numbers(snapshot.charger),
        "links": {name: _numbers(asdict(status)) | _UNKNOWN.get(name, {}) for name, status in snapshot.links.items()},
        "estimator": _numbers(snapshot.estimator),
        "plausibility": {name: _numbers(check) for name, check in snapshot.plausibility.items()},
        "alarms": [alarm_json(alarm) for alarm in snapshot.alarms],
        "config_hash": snapshot.config_hash,
    }
    return orjson.dumps(body | service, option=_OPTIONS)
