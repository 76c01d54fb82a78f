"""What people and programs may be, the least first; how long a token may hold."""

from typing import Literal

Role = Literal["viewer", "engineer", "chief"]
ROLES: tuple[Role, ...] = ("viewer", "engineer", "chief")
MOST_DAYS = 400
