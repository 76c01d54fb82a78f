"""What can be the cause: every code with its name, and what a recording cannot tell it apart from."""

from __future__ import annotations

from typing import Final

from app.words import Cell, Message, Pack

NAMES: Final[dict[str, Message]] = {
    "weak-joint": Message("cause-weak-joint"),
    "high-resistance": Message("cause-high-resistance"),
    "lost-capacity": Message("cause-lost-capacity"),
    "unbalanced-cell": Message("cause-unbalanced-cell"),
    "leaking-cell": Message("cause-leaking-cell"),
    "heated-cell": Message("cause-heated-cell"),
    "voltage-input-stuck": Message("cause-voltage-input-stuck"),
    "voltage-input-noisy": Message("cause-voltage-input-noisy"),
    "broken-wire": Message("cause-broken-wire"),
    "temperature-stuck": Message("cause-temperature-stuck"),
    "temperature-unplugged": Message("cause-temperature-unplugged"),
    "cooling-failed": Message("cause-cooling-failed"),
    "air-hot": Message("cause-air-hot"),
    "air-cold": Message("cause-air-cold"),
    "hot-pack": Message("cause-hot-pack"),
    "cold-pack": Message("cause-cold-pack"),
    "empty-pack": Message("cause-empty-pack"),
    "overload": Message("cause-overload"),
    "current-sensor-offset": Message("cause-current-sensor-offset"),
    "current-sensor-unplugged": Message("cause-current-sensor-unplugged"),
    "slave-lost": Message("cause-slave-lost"),
    "slave-line-disturbed": Message("cause-slave-line-disturbed"),
    "converter-broken": Message("cause-converter-broken"),
    "reference-drifted": Message("cause-reference-drifted"),
    "multiplexer-failed": Message("cause-multiplexer-failed"),
    "shutdown-opened": Message("cause-shutdown-opened"),
    "relays-not-closed": Message("cause-relays-not-closed"),
    "precharge-failed": Message("cause-precharge-failed"),
    "shutdown-open-before": Message("cause-shutdown-open-before"),
    "not-switched-on": Message("cause-not-switched-on"),
    "link-loaded": Message("cause-link-loaded"),
    "link-not-discharged": Message("cause-link-not-discharged"),
    "eeprom-worn": Message("cause-eeprom-worn"),
    "master-reset": Message("cause-master-reset"),
    "master-power-lost": Message("cause-master-power-lost"),
    "serial-disturbed": Message("cause-serial-disturbed"),
    "serial-cut": Message("cause-serial-cut"),
    "serial-silent": Message("cause-serial-silent"),
    "can-master-off": Message("cause-can-master-off"),
    "can-silent": Message("cause-can-silent"),
    "can-master-silent": Message("cause-can-master-silent"),
    "can-short": Message("cause-can-short"),
    "can-controller-off": Message("cause-can-controller-off"),
    "can-adapter-off": Message("cause-can-adapter-off"),
    "can-disturbed": Message("cause-can-disturbed"),
    "can-flooded": Message("cause-can-flooded"),
    "charger-hot": Message("cause-charger-hot"),
    "charger-no-mains": Message("cause-charger-no-mains"),
    "charger-reversed": Message("cause-charger-reversed"),
    "charger-silent": Message("cause-charger-silent"),
    "charger-broken": Message("cause-charger-broken"),
    "unknown": Message("cause-unknown"),
}
# A code that stands for several things of which the recording holds the same; why: docs/reference/causes.md
SAME: Final[dict[str, tuple[str, ...]]] = {
    "relays-not-closed": ("precharge-failed", "shutdown-open-before", "not-switched-on"),
    "can-silent": ("can-short", "can-adapter-off"),
    "can-master-silent": ("can-short", "can-controller-off", "can-adapter-off"),
}


def cause_message(code: str, cell: int | None, pack: int | None) -> Message:
    """Return a cause with its place; cell and pack count from 0."""
    name = NAMES[code]
    if cell is not None:
        return Message("cause-at-cell", cause=name, cell=Cell(cell))
    return name if pack is None else Message("cause-in-pack", cause=name, pack=Pack(pack))
