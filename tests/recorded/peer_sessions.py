"""Batteries of tests/peer_batteries.py as profiles on the disk, and their frames as logs of other tools."""

from pathlib import Path

import can

from firmware_protocol.memory_map import CAN_ID_EXTENDED
from tests.peer_messages import Peer

START_S = 1_780_000_000
STATUS = {"voltage": "Pack_Voltage", "current": "Pack_Current", "soc": "Pack_SOC"}


def write_profile(peer: Peer, folder: Path, *, sensors: str = "", more: str = "") -> Path:
    """Write the DBC of a peer and a profile that decodes it; return the profile's path."""
    (folder / "peer.dbc").write_text(peer.dbc())
    by_name = {bits.name for sent in peer.sent for turn in sent.turns for bits in turn}
    current = next(name for name in ("Pack_Current", "TS_Current") if name in by_name)
    path = folder / "peer.toml"
    path.write_text(
        f"""[battery]
name = "{peer.name}"
segments = {list(peer.segments or (peer.n_cells,))}
[battery.temperatures]
sensors = {peer.n_sensors}
{sensors}
[source]
dbc = "peer.dbc"
[source.current]
signal = "{current}"
positive = "{peer.positive}"
{more}
{peer.profile}"""
    )
    return path


def write_log(peer: Peer, path: Path, duration_s: float, *, start_s: float = START_S) -> Path:
    """Write the frames of a peer as what the ending of `path` says."""
    with can.Logger(str(path)) as logger:
        for t_ns, can_id, data in peer.frames(duration_s):
            logger.on_message_received(
                can.Message(
                    timestamp=start_s + t_ns / 1e9,
                    arbitration_id=can_id & ~CAN_ID_EXTENDED,
                    is_extended_id=bool(can_id & CAN_ID_EXTENDED),
                    is_fd=len(data) > 8,
                    data=data,
                    channel=0,
                )
            )
    return path
