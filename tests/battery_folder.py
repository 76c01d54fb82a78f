"""A peer's DBC and profile as files, as a team would have them."""

from pathlib import Path

from tests.peer_messages import Peer

READINGS = """
[source.current]
signal = "Pack_Current"
[source.pack_voltage]
signal = "{voltage}"
[source.soc]
signal = "Pack_SOC"
"""


def write_profile(
    folder: Path, peer: Peer, segments: tuple[int, ...], limits: str = "", voltage: str = "Pack_Voltage"
) -> Path:
    """Write `battery.dbc` and `battery.toml` into a folder and return the profile's path."""
    (folder / "battery.dbc").write_text(peer.dbc(), encoding="utf-8")
    profile = folder / "battery.toml"
    profile.write_text(
        f'[battery]\nname = "{peer.name}"\nsegments = {list(segments)}\n'
        f"[battery.temperatures]\nsensors = {peer.n_sensors}\n[battery.limits]\n{limits}\n"
        '[source]\ndbc = "battery.dbc"\n' + peer.profile + READINGS.format(voltage=voltage),
        encoding="utf-8",
    )
    return profile
