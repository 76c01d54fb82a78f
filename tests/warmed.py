"""What every service does once, done before it is forked: its imports, and the schemas of its routes."""

import app.commands.serve  # noqa: F401
from app.api.application import api_routes

for route in api_routes().routes:
    route.matches({"type": "http", "method": "GET", "path": "/", "root_path": ""})  # FastAPI makes the schemas then
