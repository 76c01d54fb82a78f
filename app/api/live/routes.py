"""Health, battery, snapshot, live stream, history."""

import asyncio
import contextlib
from typing import Annotated, Any

import orjson
from fastapi import APIRouter, Query, Response, WebSocket
from starlette.websockets import WebSocketDisconnect

from app import __version__
from app.api.schemas.battery import BatteryOut, battery_json
from app.api.schemas.service import HealthOut, HistoryOut, TrendOut
from app.api.schemas.snapshot import SnapshotOut
from app.api.web.dependencies import (
    AuthenticationPart,
    BatteryPart,
    CertificatePart,
    ClockPart,
    EncoderPart,
    FanOutPart,
    HealthPart,
    LivePart,
    block_reason,
)
from app.api.web.fan_out import Reader
from app.api.web.problems import Problem, invalid
from app.words import Message, rendered

router = APIRouter(tags=["live"])
POLL_S = 1.0  # after which a reader that was logged out gets no more


@router.get("/health", response_model=HealthOut)
async def health(
    live: LivePart,
    health: HealthPart,
    certificate: CertificatePart,
    clock: ClockPart,
    response: Response,
    strict: bool = False,
) -> dict[str, Any]:
    """Return whether the service does its work; `reasons` says in words what is missing.

    `failing`: nothing comes from the battery, or nothing gets onto the disk; with `strict` the answer is 503 then.
    """
    reasons, is_failing = health.problems(), bool(health.failures())
    if certificate is not None and (ends := certificate.problem(clock.wall_s())) is not None:
        reasons = [*reasons, ends]
    if strict and is_failing:
        response.status_code = 503
    return {
        "status": "failing" if is_failing else "degraded" if reasons else "ok",
        "version": __version__,
        "uptime_s": round(health.uptime_s, 3),
        "source": live.source,
        "reasons": [*map(rendered, reasons)],
    }


@router.get("/snapshot", responses={200: {"model": SnapshotOut}})
async def snapshot(live: LivePart, encoder: EncoderPart) -> Response:
    """The newest snapshot."""
    latest = live.hub.latest
    if latest is None:
        raise Problem(503, "nothing-yet", Message("nothing-yet"))
    return Response(encoder.encode(latest), media_type="application/json")


@router.get("/battery", response_model=BatteryOut)
def battery(battery: BatteryPart, live: LivePart) -> dict[str, Any]:
    """Shape, drawing, sensors and limits of the battery, and whether its configuration can be written."""
    limits = None if live.snapshot is None else live.snapshot.limits
    why_not = block_reason(battery)
    return battery_json(battery.battery, battery.kind, why_not, limits, has_checksum=battery.has_checksum)


@router.get("/history", responses={200: {"model": HistoryOut}})
def history(
    live: LivePart,
    seconds: Annotated[float, Query(gt=0, le=3600)] = 900,
    cell: Annotated[int | None, Query(ge=0)] = None,
) -> Response:
    """The last minutes of the main values, or of one cell, for charts that open late; extremes are kept."""
    body = live.history.read(seconds, None if cell is None else _of_battery(cell, live))
    return Response(orjson.dumps(body, option=orjson.OPT_SERIALIZE_NUMPY), media_type="application/json")


@router.get("/trend", responses={200: {"model": TrendOut}})
def trend(live: LivePart, cell: Annotated[int, Query(ge=0)]) -> Response:
    """Slow values of one cell over six hours, and how long it was balanced since the service started."""
    body = live.trend.read(_of_battery(cell, live))
    return Response(orjson.dumps(body, option=orjson.OPT_SERIALIZE_NUMPY), media_type="application/json")


def _of_battery(cell: int, live: LivePart) -> int:
    if cell >= live.n_cells:
        raise invalid("cell", cell, Message("input-at-most", limit=live.n_cells - 1))
    return cell


@router.websocket("/live")
async def stream(
    websocket: WebSocket,
    fan_out: FanOutPart,
    authentication: AuthenticationPart,
    clock: ClockPart,
    rate: float | None = None,
) -> None:
    """Send every snapshot as one text message, at most `rate` a second on average; a slow reader misses some."""
    await websocket.accept()
    if rate is not None and not 0 < rate <= 1000:
        await websocket.close(1008, "rate: between 0 and 1000 a second")
        return
    user = authentication.user_of(websocket.headers, "")
    address = websocket.client.host if websocket.client else ""
    reader = Reader(websocket.send_text, websocket.state.connection, user, address, clock.wall_s())
    with fan_out.joined(reader, rate):
        while authentication.user_of(websocket.headers, "") is not None:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(POLL_S):
                    await _end_of(websocket)
                    return
    with contextlib.suppress(WebSocketDisconnect):
        await websocket.close(4401, "logged out")


async def _end_of(websocket: WebSocket) -> None:
    """Ignore what a reader sends until it leaves."""
    while (await websocket.receive())["type"] != "websocket.disconnect":
        pass
