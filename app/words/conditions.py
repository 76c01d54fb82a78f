"""The codes of conditions: one each, the same in an alarm, a finding, a cause, a fault of the simulator and a report.

Their names are in `en/codes.json`. What was kept under an older code is read by `condition_of`.
"""

from __future__ import annotations

from typing import Final

CONDITIONS: Final = (
    # one cell and what measures it
    "joint-resistance-high", "cell-resistance-high", "capacity-low", "self-discharge-high", "cell-imbalance",
    "external-heating", "cell-voltage-stuck", "cell-voltage-noisy", "cell-voltage-missing", "sense-wire-open",
    "temperature-sensor-fault", "temperature-sensor-open",
    # limits
    "cell-undervoltage", "cell-overvoltage", "cell-overtemperature", "cell-undertemperature",
    "discharge-overcurrent", "charge-overcurrent",
    # accumulator and air
    "accumulator-hot", "accumulator-cold", "accumulator-empty", "overload", "ambient-temperature", "cooling-failed",
    # slave boards
    "slave-lost", "slave-adc-fault", "slave-reference-drift", "slave-multiplexer-fault", "isospi-noise", "sensor-lost",
    # current sensor, contactors and DC link
    "current-sensor-offset", "current-sensor-open", "external-shutdown", "contactors-not-closed",
    "precharge-failed", "hv-not-switched-on", "dc-link-load", "dc-link-discharge-failed",
    # master and links
    "eeprom-worn", "master-watchdog-reset", "master-supply-lost", "serial-noise", "serial-drop-outs", "serial-silent",
    "can-silent", "can-master-silent", "can-master-bus-off", "can-short", "can-adapter-off", "can-noise",
    "can-babbling-node",
    # charger
    "charger-hardware-fault", "charger-over-temperature", "charger-input-voltage", "charger-no-battery",
    "charger-time-out", "charger-silent",
)  # fmt: skip
_BEFORE: Final[dict[str, tuple[str, ...]]] = {
    "joint-resistance-high": ("joint-loose", "joint-grown", "weak-joint"),
    "cell-resistance-high": ("resistance-grown", "high-resistance"),
    "capacity-low": ("capacity-lost", "lost-capacity"),
    "self-discharge-high": ("cell-leaks", "leaking-cell"),
    "cell-imbalance": ("unbalanced-cell",),
    "external-heating": ("heated-cell",),
    "cell-voltage-stuck": ("channel-stuck", "voltage-input-stuck"),
    "cell-voltage-noisy": ("voltage-input-noisy",),
    "cell-voltage-missing": ("cell-missing",),
    "sense-wire-open": ("broken-wire",),
    "temperature-sensor-fault": ("thermistor-off", "temperature-stuck"),
    "temperature-sensor-open": ("temperature-unplugged",),
    "cell-undervoltage": ("cell-voltage-low", "under-voltage", "v-min"),
    "cell-overvoltage": ("cell-voltage-high", "over-voltage", "v-max"),
    "cell-undervoltage-near": ("cell-voltage-near-low",),
    "cell-overvoltage-near": ("cell-voltage-near-high",),
    "cell-overtemperature": ("cell-hot", "too-hot", "t-max"),
    "cell-overtemperature-near": ("cell-near-hot",),
    "cell-undertemperature": ("cell-cold", "too-cold", "t-min"),
    "discharge-overcurrent": ("current-high", "discharge-over-current", "i-disc"),
    "charge-overcurrent": ("current-low", "charge-over-current", "i-chrg"),
    "accumulator-hot": ("hot-pack",),
    "accumulator-cold": ("cold-pack",),
    "accumulator-empty": ("empty-pack",),
    "ambient-temperature": ("air-hot", "air-cold"),
    "slave-lost": ("slave-missing",),
    "slave-adc-fault": ("converter-broken",),
    "slave-reference-drift": ("reference-drifted",),
    "slave-multiplexer-fault": ("multiplexer-failed",),
    "isospi-noise": ("slave-line-disturbed",),
    "current-sensor-open": ("current-sensor-unplugged",),
    "external-shutdown": ("shutdown-opened", "shutdown-open-before"),
    "contactors-not-closed": ("relays-not-closed",),
    "hv-not-switched-on": ("not-switched-on",),
    "dc-link-load": ("link-loaded",),
    "dc-link-discharge-failed": ("link-not-discharged",),
    "master-watchdog-reset": ("master-reset",),
    "master-supply-lost": ("master-power-lost",),
    "serial-noise": ("serial-disturbed",),
    "serial-drop-outs": ("serial-cut",),
    "can-master-bus-off": ("can-master-off", "can-controller-off"),
    "can-noise": ("can-disturbed",),
    "can-babbling-node": ("can-flooded",),
    "charger-hardware-fault": ("charger-hardware", "charger-broken"),
    "charger-over-temperature": ("charger-hot",),
    "charger-input-voltage": ("charger-no-mains",),
    "charger-no-battery": ("charger-battery", "charger-reversed"),
}
_NOW: Final = {old: code for code, before in _BEFORE.items() for old in before} | {
    "finding-thermistor-missing": "finding-temperature-sensor-open",
    "finding-channel-missing": "finding-cell-voltage-missing",
    # messages, not conditions: their codes were other words
    "boot-cause-unknown": "boot-cause-unknown",
    "bms-state": "bms-state",
    "bms-no-state": "bms-no-state",
    "cells-not-received": "cells-not-received",
    "all-faults-cleared": "all-faults-cleared",
    "can-only-session": "can-only-session",
    "charger-reported-range": "charger-reported-range",
}
_PREFIXES: Final = ("trip-", "finding-")  # before the condition's code, of events and messages


def condition_of(code: str) -> str:
    """Return today's code for one that an earlier version kept; any other code is returned as it is."""
    if code in _NOW:
        return _NOW[code]
    if code.startswith("cause-"):  # an earlier version's name of a cause
        name = code.removeprefix("cause-")
        return _NOW.get(name, name if name in CONDITIONS else code)
    prefix = next((prefix for prefix in _PREFIXES if code.startswith(prefix)), "")
    rest = code.removeprefix(prefix)
    return prefix + _NOW.get(rest, rest)
