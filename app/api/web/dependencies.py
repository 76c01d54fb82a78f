"""Dependencies of routes: the part of the service that they need, and the user. Each is named once, here."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, cast

from fastapi import Depends
from starlette.requests import HTTPConnection

from app.analysis.black_box.from_session import BlackBoxesOfSessions
from app.analysis.black_box.recorder import BlackBoxRecorder
from app.api.access.certificate import Certificate
from app.api.access.phones import PhoneAccess
from app.api.encoding.encoder import SnapshotEncoder
from app.api.web.authentication import Authentication, User
from app.api.web.fan_out import FanOut
from app.api.web.problems import Problem
from app.clock import Clock
from app.configuration.config_sources import ConfigSources
from app.configuration.configuration_store import ConfigurationStore
from app.configuration.history import ConfigHistory
from app.configuration.safe_write import ConfigurationWriter
from app.configuration.slave_check import SlaveCheckLog
from app.configuration.write_log import WriteLog
from app.live.can_trace import CanTrace
from app.live.pipeline_factory import PipelineFactory
from app.season.history import SeasonSource
from app.season.season_lake import SeasonLake
from app.service.events import Events
from app.service.health.checks import Health
from app.service.host import ClockWatch
from app.service.links import ServiceLinks
from app.service.master import ConfigurationInForce, MasterCommands, Rules
from app.service.mqtt.fleet import Fleet
from app.service.pipeline_thread import PipelineThread
from app.service.service import Service
from app.service.settings import Settings
from app.service.simulator_process import SimulatorProcess
from app.sessions.catalogue import Catalogue
from app.sessions.recording.auto_recorder import AutoRecorder
from app.sessions.replay import ReplayPlayer
from app.sessions.swaps import SwapFile
from app.sessions.transfer.fetch_jobs import FetchJobs
from app.sessions.transfer.follow import Followers
from app.sessions.transfer.import_jobs import ImportJobs
from app.sessions.worker import Workers
from app.sources.connections import Setup
from app.sources.links.driver_display import DriverDisplay
from app.sources.loaded_battery import LoadedBattery
from app.words import Message


@dataclass(frozen=True, slots=True)
class WebParts:
    """The service, and what only the web server needs; kept as `app.state.parts`."""

    service: Service
    authentication: Authentication
    encoder: SnapshotEncoder
    fan_out: FanOut
    clock_watch: ClockWatch
    phones: PhoneAccess
    simulator: SimulatorProcess | None
    setup: Setup
    certificate: Certificate | None = None  # certificate of HTTPS
    fleet: Fleet | None = None  # the fleet of a page without a service


@dataclass(frozen=True, slots=True)
class FleetParts:
    """Parts of the service that the page of several cars needs, in the place of WebParts."""

    fleet: Fleet
    authentication: Authentication


# Most are `async`, though they wait for nothing: FastAPI sends each other one to a thread, a dozen hops a request.
def _web(connection: HTTPConnection) -> WebParts:
    return cast(WebParts, connection.app.state.parts)


def _part(of: Callable[[WebParts], object]) -> Any:
    async def part(connection: HTTPConnection) -> object:
        return of(_web(connection))

    return Depends(part)


def _season_source(connection: HTTPConnection) -> SeasonSource:
    service = _web(connection).service
    swaps = tuple(service.swaps.read())
    is_simulated = service.live.source == "simulator"
    return SeasonSource(service.season.place, service.battery.battery, is_simulated, service.pipelines.cell, swaps)


async def _simulator(connection: HTTPConnection) -> SimulatorProcess:
    simulator = _web(connection).simulator
    if simulator is None:
        raise Problem(404, "not-found", Message("no-simulator"))
    return simulator


async def _fleet(connection: HTTPConnection) -> Fleet:
    fleet = _web(connection).fleet
    if fleet is None:
        raise Problem(404, "not-found", Message("no-fleet"))
    return fleet


async def _writable(connection: HTTPConnection) -> None:
    why_not = block_reason(_web(connection).service.battery)
    if why_not is not None:
        raise Problem(409, "battery-not-writable", why_not)


def block_reason(battery: LoadedBattery) -> Message | None:
    """Return why the configuration of a battery cannot be written; None where it can."""
    return None if battery.has_memory_map else Message("battery-not-writable")


async def _user(connection: HTTPConnection) -> User:
    """The middleware let nobody through without one, but for the open paths."""
    return cast(User, connection.state.user)


NEEDS_MASTER = Depends(_writable)  # dependency of routes that read or write a master's configuration, or command it

BatteryPart = Annotated[LoadedBattery, _part(lambda web: web.service.battery)]
BlackBoxesPart = Annotated[BlackBoxRecorder, _part(lambda web: web.service.black_boxes)]
BoxesOfSessionsPart = Annotated[BlackBoxesOfSessions, _part(lambda web: web.service.boxes_of_sessions)]
CanTracePart = Annotated[CanTrace, _part(lambda web: web.service.trace)]
CataloguePart = Annotated[Catalogue, _part(lambda web: web.service.catalogue)]
CommandsPart = Annotated[MasterCommands, _part(lambda web: web.service.commands)]
ClockPart = Annotated[Clock, _part(lambda web: web.service.clock)]
ConfigHistoryPart = Annotated[ConfigHistory, _part(lambda web: web.service.configuration.history)]
ConfigSourcesPart = Annotated[ConfigSources, _part(lambda web: web.service.configuration.sources)]
ConfigurationPart = Annotated[ConfigurationWriter, _part(lambda web: web.service.configuration.writer)]
DriverDisplayPart = Annotated[DriverDisplay, _part(lambda web: web.service.driver_display)]
EventsPart = Annotated[Events, _part(lambda web: web.service.events)]
FleetPart = Annotated[Fleet, Depends(_fleet)]
FollowersPart = Annotated[Followers, _part(lambda web: web.service.followers)]
FetchesPart = Annotated[FetchJobs, _part(lambda web: web.service.fetches)]
HealthPart = Annotated[Health, _part(lambda web: web.service.health)]
ImportsPart = Annotated[ImportJobs, _part(lambda web: web.service.imports)]
InForcePart = Annotated[ConfigurationInForce, _part(lambda web: web.service.configuration.in_force)]
LinksPart = Annotated[ServiceLinks, _part(lambda web: web.service.links)]
LivePart = Annotated[PipelineThread, _part(lambda web: web.service.live)]
PipelinesPart = Annotated[PipelineFactory, _part(lambda web: web.service.pipelines)]
ProfilesPart = Annotated[ConfigurationStore, _part(lambda web: web.service.configuration.profiles)]
RecorderPart = Annotated[AutoRecorder, _part(lambda web: web.service.recorder)]
ReplayPart = Annotated[ReplayPlayer, _part(lambda web: web.service.replay)]
RulesPart = Annotated[Rules, _part(lambda web: web.service.configuration.rules)]
SeasonSourcePart = Annotated[SeasonSource, Depends(_season_source)]
SeasonPart = Annotated[SeasonLake, _part(lambda web: web.service.season)]
SettingsPart = Annotated[Settings, _part(lambda web: web.service.settings)]
SignedPart = Annotated[WriteLog, _part(lambda web: web.service.configuration.write_log)]
SwapsPart = Annotated[SwapFile, _part(lambda web: web.service.swaps)]
WorkersPart = Annotated[Workers, _part(lambda web: web.service.workers)]
SlaveChecksPart = Annotated[SlaveCheckLog, _part(lambda web: web.service.configuration.slave_checks)]

AuthenticationPart = Annotated[Authentication, _part(lambda web: web.authentication)]
CertificatePart = Annotated[Certificate | None, _part(lambda web: web.certificate)]
PhonesPart = Annotated[PhoneAccess, _part(lambda web: web.phones)]
ClockWatchPart = Annotated[ClockWatch, _part(lambda web: web.clock_watch)]
EncoderPart = Annotated[SnapshotEncoder, _part(lambda web: web.encoder)]
FanOutPart = Annotated[FanOut, _part(lambda web: web.fan_out)]
SetupPart = Annotated[Setup, _part(lambda web: web.setup)]
SimulatorPart = Annotated[SimulatorProcess, Depends(_simulator)]
UserDep = Annotated[User, Depends(_user)]
