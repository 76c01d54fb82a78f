"""A battery by its shape alone, `2x6`: profile and DBC are made for it, one signal a cell. For the simulator."""

import re

from app.battery.table_reader import ProfileError
from app.words import Message

MOST_CELLS = 600  # four voltages a frame: 150 messages, and as many as half a bus of 500 kbit/s carries every 0.1 s
_PER_FRAME = {"Voltage": 4, "Temperature": 8}
_FIRST_ID = {"Voltage": 0x100, "Temperature": 0x300}
_BITS = {
    "Voltage": '16@1+ (0.0001,0) [0|6.5535] "V"',
    "Temperature": '8@1+ (0.5,-40) [-40|87] "degC"',  # 255: not measured
}
_PROFILE = """\
[battery]
name = "{n_packs} x {in_series} cells"
packs = {packs}

[source]
dbc = "{name}.dbc"

[[source.voltage]]
signal = "Voltage_{{cell}}"
base = 1
invalid = [0, 65535]

[[source.temperature]]
signal = "Temperature_{{cell}}"
base = 1
invalid = [255]

[source.current]
signal = "Status.Current"
positive = "discharge"

[source.pack_voltage]
signal = "Status.Pack_Voltage"

[source.soc]
signal = "Status.SOC"
unit = "percent"

[source.state.closed]
signal = "Status.Relays_Closed"

[source.state.charging]
signal = "Status.Charging"

[source.state.fault]
signal = "Status.Fault"
"""
_STATUS = """\
BO_ 128 Status: 8 BMS
 SG_ Pack_Voltage : 0|16@1+ (0.1,0) [0|6553.5] "V" PIT
 SG_ Current : 16|16@1- (0.02,0) [-655|655] "A" PIT
 SG_ SOC : 32|16@1+ (0.01,0) [0|100] "%" PIT
 SG_ Relays_Closed : 48|1@1+ (1,0) [0|1] "" PIT
 SG_ Charging : 49|1@1+ (1,0) [0|1] "" PIT
 SG_ Fault : 50|1@1+ (1,0) [0|1] "" PIT
"""


def files_of_shape(name: str) -> dict[str, bytes] | None:
    """Return profile and DBC of a battery of `2x6` packs x cells in series in each; None: no name of this kind.

    Raises:
        ProfileError: no cells, or more than a bus carries.
    """
    match = re.fullmatch(r"(\d{1,9})x(\d{1,9})", name, re.ASCII)
    if match is None:
        return None
    n_packs, in_series = map(int, match.groups())
    if not 1 <= n_packs * in_series <= MOST_CELLS:
        raise ProfileError(name, None, "battery", name, Message("shape-of-cells", most=MOST_CELLS))
    profile = _PROFILE.format(name=name, n_packs=n_packs, in_series=in_series, packs=[in_series] * n_packs)
    return {f"{name}.toml": profile.encode(), f"{name}.dbc": _dbc(n_packs * in_series).encode()}


def _dbc(n_cells: int) -> str:
    messages = [_STATUS]
    for kind, per_frame in _PER_FRAME.items():
        for k, first in enumerate(range(0, n_cells, per_frame)):
            lines = [f"BO_ {_FIRST_ID[kind] + k} {kind}s_{k + 1}: 8 BMS"]
            for cell in range(first, min(first + per_frame, n_cells)):
                start = (cell - first) * 64 // per_frame
                lines.append(f" SG_ {kind}_{cell + 1} : {start}|{_BITS[kind]} PIT")
            messages.append("\n".join(lines) + "\n")
    return 'VERSION ""\n\nNS_ :\n\nBS_:\n\nBU_: BMS PIT\n\n' + "\n".join(messages)
