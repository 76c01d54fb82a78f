"""Several batteries behind one address: `/` is the first, `/beside/NAME/` each other, with all pages and routes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from starlette.responses import RedirectResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from app.service.pipeline_thread import PipelineThread
from app.sources.loaded_battery import LoadedBattery
from app.words import Message, naming_cells

FIRST = "/"


@dataclass(frozen=True, slots=True)
class ServedBattery:
    """A battery, and the path of its pages, which begins and ends with a slash."""

    path: str
    app: ASGIApp
    battery: LoadedBattery
    live: PipelineThread
    stalls: Callable[[], list[Message]]  # what of it stands still


class BatterySwitch:
    """ASGI application: hands every request to the battery of its path. The first takes the lifespan."""

    def __init__(self, first: ASGIApp, further: Sequence[ServedBattery]) -> None:
        self._first = first
        self._further = further

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Take the battery off the path and hand on what is left of it."""
        if scope["type"] in ("http", "websocket"):
            for each in self._further:
                if scope["path"] + "/" == each.path and scope["type"] == "http":
                    await RedirectResponse(each.path)(scope, receive, send)
                    return
                if scope["path"].startswith(each.path):
                    with naming_cells(each.battery.battery.segments):
                        await each.app(_within(scope, each.path), receive, send)
                    return
        await self._first(scope, receive, send)


def _within(scope: Scope, path: str) -> Scope:
    """The same request as the battery's own application knows it."""
    cut = len(path) - 1
    raw = scope.get("raw_path")
    return {**scope, "path": scope["path"][cut:], "raw_path": None if raw is None else raw[cut:]}
