"""What every service does once, done before it is forked: its imports, the schemas of its routes, whom it trusts."""

import gc

import app.commands.serve  # noqa: F401
from app.api.application import api_routes
from app.sessions.transfer.trust import context_for

for route in api_routes().routes:
    route.matches({"type": "http", "method": "GET", "path": "/", "root_path": ""})  # FastAPI makes the schemas then
context_for(None)  # reads the certificates of the system: a tenth of a start
gc.collect()
gc.freeze()  # else each service looks through all that for garbage, and copies the pages by doing so
