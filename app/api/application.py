"""Settings in, ASGI application out: the web server around the parts of app/service/wiring.py."""

import asyncio
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from functools import cache
from pathlib import Path
from typing import NamedTuple

from fastapi import APIRouter, FastAPI
from starlette.routing import BaseRoute

from app import __version__
from app.api import balancing, simulator
from app.api.access.accounts import Accounts
from app.api.access.certificate import Certificate
from app.api.access.login_log import LoginLog
from app.api.access.phones import PhoneAccess
from app.api.can import bus as can_bus
from app.api.can import tables as can
from app.api.configuration import commands, slave_check
from app.api.configuration import library as config_library
from app.api.configuration import routes as config
from app.api.encoding.encoder import SnapshotEncoder
from app.api.live import events, fleet, metrics, profile_inference, race, system
from app.api.live import routes as live
from app.api.live import setup as first_steps
from app.api.schemas.service import ProblemOut
from app.api.sessions import analysis as debrief
from app.api.sessions import imports, recorder, season, season_cells, transfer
from app.api.sessions import routes as sessions
from app.api.web import login as session_login
from app.api.web import openapi, people, phones, problems
from app.api.web.authentication import Authentication, AuthenticationMiddleware
from app.api.web.dependencies import NEEDS_MASTER, FleetParts, WebParts
from app.api.web.fan_out import FanOut
from app.api.web.middleware import BodyLimit, HeadAsGet, RequestFraming, SecurityHeaders
from app.api.web.static import serve_front_end
from app.clock import Clock
from app.service.host import ClockWatch
from app.service.mqtt.broker import parse_broker
from app.service.mqtt.fleet import Fleet
from app.service.settings import Settings
from app.service.simulator_process import SimulatorProcess
from app.service.wiring import make_service
from app.sessions.replay import Estimates, ReplayOptions
from app.sessions.worker import DEFINITIONS
from app.sources.connections import Connections, Setup
from app.sources.loaded_battery import load_battery
from app.telemetry import Source

STATIC = Path(__file__).parents[1] / "static"


class ServedReplay(NamedTuple):
    """A recorded session to show instead of a link."""

    path: Path
    speed: float
    estimates: Estimates = "recomputed"
    cell_name: str | None = None  # the session's own


def create_app(
    settings: Settings,
    source: Source,
    *,
    serial_url: str | None,
    can_url: str | None,
    replay: ServedReplay | None = None,
    simulated_car: SimulatorProcess | None = None,
    clock: Clock | None = None,
    setup: Setup | None = None,
    certificate: Certificate | None = None,
) -> FastAPI:
    """Return the application; its lifespan opens the links and closes them. Without `clock` it is the computer's.

    With `certificate` it is served by HTTPS. Without `setup` what is read cannot be chosen on the page.

    Raises:
        ConfigError: a setting is wrong or unsafe.
    """
    accounts = Accounts(settings.data)
    settings.check(has_accounts=accounts.exist)
    clock = clock or Clock()
    service = make_service(settings, clock, source=source, serial_url=serial_url, can_url=can_url)

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        service.live.hub.attach(asyncio.get_running_loop())
        try:
            service.start()
            if replay is not None:
                options = ReplayOptions(replay.speed, cell_name=replay.cell_name, estimates=replay.estimates)
                service.replay.start(replay.path, options)
            yield
        finally:
            await asyncio.to_thread(service.stop)

    app = FastAPI(
        title="Voltwall",
        version=__version__,
        summary="The pit wall for a Formula Student battery",
        lifespan=lifespan,
        openapi_url="/api/v1/openapi.json",
        docs_url=None,
        redoc_url=None,
    )
    logins = LoginLog(service.configuration.write_log, service.events.note, clock)
    authentication = Authentication(settings, clock, accounts, logins)
    phone_access = PhoneAccess(settings)
    authentication.network_port = lambda: phone_access.port
    phone_access.is_open_to_all = lambda: authentication.is_open
    setup = setup or Setup(settings.data, Connections(settings.serial, settings.can, settings.battery))
    setup.load = lambda name, **named: service.workers.run(DEFINITIONS, load_battery, name, **named)
    encoder = SnapshotEncoder(service.state, service.clock)
    app.state.parts = WebParts(
        service=service,
        authentication=authentication,
        encoder=encoder,
        fan_out=FanOut(service.live.hub, encoder),
        clock_watch=ClockWatch(clock),
        simulator=simulated_car,
        setup=setup,
        certificate=certificate,
        phones=phone_access,
    )
    openapi.install(app)

    @app.get("/api/v1/asyncapi.json", include_in_schema=False)
    def live_document() -> dict[str, object]:
        return openapi.asyncapi(app.openapi())

    _serve_web(app, api_routes().routes, "index.html", authentication)
    return app


def create_fleet_app(settings: Settings, clock: Clock | None = None) -> FastAPI:
    """Return the application that shows all cars of the broker `settings.fleet`; it has no car of its own.

    Raises:
        ConfigError: a setting is wrong or unsafe, or paho-mqtt is not installed.
    """
    accounts = Accounts(settings.data)
    settings.check(has_accounts=accounts.exist)
    clock = clock or Clock()
    broker = parse_broker(settings.fleet or "", settings.mqtt_secret, settings.mqtt_ca, field="fleet")
    cars = Fleet(broker, clock)

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        cars.start()
        yield
        await asyncio.to_thread(cars.stop)

    app = FastAPI(title="Voltwall", version=__version__, lifespan=lifespan, openapi_url=None, docs_url=None)
    authentication = Authentication(settings, clock, accounts)
    app.state.parts = FleetParts(cars, authentication)
    routes = APIRouter()
    for router in (fleet.router, fleet.alone, session_login.router, people.router):
        routes.include_router(router, prefix="/api/v1")
    _serve_web(app, routes.routes, "fleet.html", authentication)
    return app


def _serve_web(app: FastAPI, routes: Sequence[BaseRoute], page: str, authentication: Authentication) -> None:
    """Add what every application has: errors, routes, the front end's page, limits, log-in."""
    problems.install(app)
    app.router.redirect_slashes = False
    app.router.routes.extend(routes)
    serve_front_end(app, STATIC, page)
    app.add_middleware(HeadAsGet)
    app.add_middleware(BodyLimit)
    app.add_middleware(AuthenticationMiddleware, authentication=authentication)
    app.add_middleware(RequestFraming)
    app.add_middleware(SecurityHeaders, has_name=not authentication.settings.is_loopback)


@cache
def api_routes() -> APIRouter:
    """The routes, made once: FastAPI takes longer over their schemas than over all else in an application."""
    api = APIRouter(responses={"default": {"model": ProblemOut, "description": "What went wrong"}})
    for module in (
        can,
        can_bus,
        debrief,
        events,
        first_steps,
        fleet,
        imports,
        profile_inference,
        live,
        race,
        season,
        season_cells,
        recorder,
        session_login,
        people,
        phones,
        sessions,
        simulator,
        balancing,
        system,
        transfer,
    ):
        api.include_router(module.router, prefix="/api/v1")
    for module in (commands, config, config_library, slave_check):
        api.include_router(module.router, prefix="/api/v1", dependencies=[NEEDS_MASTER])
    api.include_router(metrics.router)
    return api
