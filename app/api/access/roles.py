"""Roles of people and programs, the least first; lifetimes of tokens."""

from typing import Literal

Role = Literal["viewer", "engineer", "chief"]
ROLES: tuple[Role, ...] = ("viewer", "engineer", "chief")
MOST_DAYS = 400
