"""The parts of the service, and in which order they start and end."""

import threading
from dataclasses import dataclass

from app.analysis.black_box.from_session import BlackBoxesOfSessions
from app.analysis.black_box.recorder import BlackBoxRecorder
from app.clock import Clock
from app.live.can_trace import CanTrace
from app.live.pipeline_factory import PipelineFactory
from app.season.season_lake import SeasonLake
from app.service.events import Events
from app.service.health.checks import Health
from app.service.learned_state_saver import LearnedStateSaver
from app.service.links import ServiceLinks
from app.service.master import MasterCommands, MasterConfiguration, MasterIdentification
from app.service.mqtt.publisher import MqttPublisher
from app.service.pipeline_thread import PipelineThread
from app.service.session_watch import SessionWatch
from app.service.settings import Settings
from app.service.state import ServiceStateReader
from app.sessions.catalogue import Catalogue
from app.sessions.recording.auto_recorder import AutoRecorder
from app.sessions.replay import ReplayPlayer
from app.sessions.retention import Retention
from app.sessions.swaps import SwapFile
from app.sessions.transfer.fetch_jobs import FetchJobs
from app.sessions.transfer.follow import Followers
from app.sessions.transfer.import_jobs import ImportJobs
from app.sessions.worker import Workers
from app.sources.links.driver_display import DriverDisplay
from app.sources.loaded_battery import LoadedBattery


@dataclass(frozen=True, slots=True)
class Service:
    """All of them. A route asks for the one that it needs: see app/api/web/dependencies.py."""

    settings: Settings
    clock: Clock
    battery: LoadedBattery
    events: Events
    links: ServiceLinks
    driver_display: DriverDisplay
    live: PipelineThread
    trace: CanTrace
    pipelines: PipelineFactory
    replay: ReplayPlayer
    recorder: AutoRecorder
    catalogue: Catalogue
    retention: Retention
    season: SeasonLake
    fetches: FetchJobs
    followers: Followers
    imports: ImportJobs
    swaps: SwapFile
    black_boxes: BlackBoxRecorder
    session_watch: SessionWatch
    boxes_of_sessions: BlackBoxesOfSessions
    configuration: MasterConfiguration
    identification: MasterIdentification
    commands: MasterCommands
    learned_state: LearnedStateSaver
    mqtt: MqttPublisher | None
    health: Health
    state: ServiceStateReader
    workers: Workers
    reading: Workers

    def start(self) -> None:
        """Start the threads; the links are opened as soon as the estimator is ready for what they deliver."""
        if self.settings.trust is not None:
            self.configuration.write_log.note(
                "voltwall serve", "setup", f"trust {self.settings.trust} for every service"
            )
        self.live.start()
        self.retention.start()
        self.season.start()
        self.followers.start()
        if self.mqtt is not None:
            self.mqtt.start()
        # Its end is not waited for: what a first start compiles may take long, and a stop must not
        threading.Thread(target=self._open_links, name="open links", daemon=True).start()

    def _open_links(self) -> None:
        self.live.warm_up()
        self.links.open()

    def stop(self) -> None:
        """End in the order of the flow: who asks, who delivers, who works on it, who keeps it (docs: how it works)."""
        self.workers.close()
        self.reading.close()
        self.replay.stop()
        self.retention.stop()
        self.season.stop()
        self.followers.stop()
        self.driver_display.stop()
        self.links.close()
        self.live.stop()
        self.session_watch.stop()
        self.recorder.close()
        self.learned_state.save()
        self.identification.stop()
        self.boxes_of_sessions.close()
        self.black_boxes.close()
        if self.mqtt is not None:
            self.mqtt.stop()
        self.configuration.write_log.close()
        self.events.store.close()
