"""What every service and simulated car does once, done before it is forked: its imports, the schemas of its routes."""

import app.commands.server  # noqa: F401
import simulator.can_ports
import simulator.control_server
import simulator.scenario_player  # noqa: F401
from app.api.application import api_routes

for route in api_routes().routes:
    route.matches({"type": "http", "method": "GET", "path": "/", "root_path": ""})  # FastAPI makes the schemas then
