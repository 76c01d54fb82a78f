"""Whose session it is: the name of a car as season, passports and lake use it."""

from app.battery.library import file_name_of
from app.sessions.info import SessionInfo


def car_of(info: SessionInfo, battery: str) -> str:
    """Return what the session says (`serve --car`), else its battery's name; a simulated car is another one."""
    name = file_name_of(str(info.metadata.get("car") or battery))
    return f"{name}-simulated" if info.metadata.get("source") == "simulator" else name
