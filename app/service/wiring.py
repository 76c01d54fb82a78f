"""Makes the parts of the service and connects them: the only place that knows them all.

The parts are made in the order in which they need each other. Items flow from the links through the inbox and the
pipeline to the listeners, which are called in the order in which they stand here.
"""

import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

from app.analysis.black_box.box import BlackBox
from app.analysis.black_box.of_sessions import BlackBoxesOfSessions
from app.analysis.black_box.recorder import BlackBoxRecorder
from app.analysis.incidents import Trigger
from app.analysis.replay import cause_of_trip_at, pipelines_of
from app.analysis.root_cause.cause import Cause, trip_cause
from app.analysis.root_cause.from_session import cause_of_trip
from app.clock import Clock, ClockRun
from app.configuration.config_sources import ConfigSources
from app.configuration.history import ConfigHistory
from app.configuration.profile_store import Profiles
from app.configuration.safe_write import ConfigurationWriter
from app.configuration.slave_check import SlaveCheckLog
from app.configuration.write_log import WriteLog
from app.estimation.cell_model.cell_file import format_cell
from app.live.can_trace import CanTrace
from app.live.hub import Hub
from app.live.learned_state import learned_file, load_learned_state
from app.live.load import Load
from app.live.pipeline import Output
from app.live.pipeline_factory import PipelineFactory
from app.season.cells.history import SeasonSource
from app.season.season_lake import SeasonLake
from app.service.events import Events
from app.service.failures import Failures
from app.service.health.checks import Health
from app.service.health.damaged_files import DamagedFiles
from app.service.host import is_clock_synchronised
from app.service.inbox import Inbox
from app.service.learned_state_saver import LearnedStateSaver
from app.service.links import Links
from app.service.master import ConfigurationInForce, MasterCommands, MasterIdentification, Rules
from app.service.mqtt.publisher import MqttPublisher, configured_publisher
from app.service.pipeline_thread import PipelineThread
from app.service.settings import Settings
from app.service.state import ServiceStateReader, recording_state
from app.sessions.catalogue import Catalogue
from app.sessions.event_log import EventLog
from app.sessions.limited_reader import LimitedReader
from app.sessions.recording.auto_recorder import AutoRecorder
from app.sessions.recording.disk import DiskLimits
from app.sessions.replay import ReplayPlayer
from app.sessions.retention import Retention, RetentionRule
from app.sessions.swaps import SwapFile
from app.sessions.transfer.fetch_jobs import FetchJobs
from app.sessions.transfer.follow import GONE_S, Follower, Followers, remotes_of
from app.sessions.transfer.import_jobs import ImportJobs
from app.sessions.transfer.session_copy import remove_left_halves
from app.sessions.worker import Workers
from app.sources.links.driver_display import DriverDisplay
from app.sources.loaded_battery import LoadedBattery, load_battery, team_battery
from app.telemetry import Event, Snapshot, Source
from app.telemetry.aging import aged
from app.telemetry.measurement import STALE_S
from app.words import Message
from firmware_protocol.can_tables import ids_of
from firmware_protocol.config_image import default_image


@dataclass(frozen=True, slots=True)
class Service:
    """The parts. A route asks for the one that it needs: see app/api/web/dependencies.py."""

    settings: Settings
    clock: Clock
    battery: LoadedBattery
    events: Events
    links: Links
    driver_display: DriverDisplay
    live: PipelineThread
    trace: CanTrace
    pipelines: PipelineFactory
    replay: ReplayPlayer
    recorder: AutoRecorder
    catalogue: Catalogue
    retention: Retention
    season: SeasonLake
    season_source: Callable[[], SeasonSource]
    fetches: FetchJobs
    followers: Followers
    imports: ImportJobs
    swaps: SwapFile
    black_boxes: BlackBoxRecorder
    boxes_of_sessions: BlackBoxesOfSessions
    configuration: ConfigurationWriter
    in_force: ConfigurationInForce
    rules: Rules
    config_history: ConfigHistory
    write_log: WriteLog
    config_sources: ConfigSources
    profiles: Profiles
    slave_checks: SlaveCheckLog
    commands: MasterCommands
    learned_state: LearnedStateSaver
    mqtt: MqttPublisher | None
    health: Health
    state: ServiceStateReader
    workers: Workers
    reading: Workers
    jobs: ThreadPoolExecutor

    def start(self) -> None:
        """Start the threads; the links are opened as soon as the estimator is ready for what they deliver."""
        if self.settings.trust is not None:
            self.write_log.note("voltwall serve", "setup", f"trust {self.settings.trust} for every service")
        self.live.start()
        self.retention.start()
        self.season.start()
        self.followers.start()
        if self.mqtt is not None:
            self.mqtt.start()
        # Not in `jobs`, whose end is waited for: what a first start compiles may take long, and a stop must not
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
        self.recorder.close()
        self.learned_state.save()
        self.jobs.shutdown(wait=True, cancel_futures=True)
        self.boxes_of_sessions.close()
        self.black_boxes.close()
        if self.mqtt is not None:
            self.mqtt.stop()
        self.write_log.close()
        self.events.store.close()


def make_service(
    settings: Settings, clock: Clock, *, source: Source, serial_url: str | None, can_url: str | None
) -> Service:
    """Return the connected parts; nothing runs before `start`.

    Raises:
        ConfigError: there is no such battery, filter, cell, broker, or the event's name is too long.
        AppError: a file of the data folder cannot be used.
    """
    data, sessions_folder = settings.data, settings.data / "sessions"
    data.mkdir(parents=True, exist_ok=True)

    # Events, and what is recorded
    damaged = DamagedFiles()
    events = Events(EventLog(data / "events.sqlite", clock, damaged.add), clock)
    damaged.note_into(events.note)
    battery = load_battery(settings.battery)
    pipelines = PipelineFactory(settings.filter, settings.cell, battery, stopwatch_ns=time.perf_counter_ns)
    recorder = AutoRecorder(
        sessions_folder,
        clock=clock,
        automatic=settings.record,
        on_event=events.add,
        event=settings.event,
        limits=DiskLimits(session_bytes=settings.split_bytes),
        source=source,
        cell_file=format_cell(pipelines.cell),
        battery=battery,
        car=settings.car,
    )
    mqtt = configured_publisher(settings, lambda: recording_state(recorder), clock, source, battery.battery)
    events.subscribe(recorder.on_event)
    if mqtt is not None:
        events.subscribe(mqtt.offer_event)

    # Sessions on the disk
    remove_left_halves(sessions_folder, clock.wall_s())
    reading = Workers()  # for itself, so that a list waits for no export
    limited = LimitedReader(reading, (battery.files, format_cell(pipelines.cell)))
    events.subscribe(limited.on_event)
    catalogue = Catalogue(sessions_folder, limited)
    rule = RetentionRule(settings.keep_days, settings.keep_gb)
    retention = Retention(
        catalogue,
        rule,
        lambda severity, message: events.note(severity, "session-expired", message),
        clock,
        is_clock_synchronised,
    )
    workers = Workers()
    season = SeasonLake(data, settings.lake, workers, builds=settings.season)
    events.subscribe(season.on_event)

    def session_id() -> str | None:
        return None if (session := recorder.session) is None else session.id

    def black_box_made(box: BlackBox) -> None:
        what = box.text if box.text_words is None else box.text_words.message
        made = Message("black-box", what=what) if box.is_complete else Message("black-box-incomplete", what=what)
        events.add(Event(clock.wall_ns(), "info", "blackbox", made, cell=box.cell))
        if box.cause is not None and box.severity == "trip":
            message = Message("trip-cause", cause=box.cause.message_words.message)
            events.add(Event(clock.wall_ns(), "info", "trip-cause", message, cell=box.cause.cell))
            pipeline.explain(trip_cause(box.cause))

    def explain(recorded: str, trigger: Trigger) -> Cause | None:
        """Look for the cause in what is on the disk of the recording that runs."""
        recorder.flush()
        with catalogue.open(recorded) as session:
            return cause_of_trip(session, trigger, pipelines.cell)

    is_simulated = source == "simulator"
    boxes_path = data / "blackboxes.sqlite"
    boxes_lost = threading.Event()
    black_boxes = BlackBoxRecorder(
        boxes_path,
        session_id,
        black_box_made,
        explain,
        is_simulated=is_simulated,
        battery=battery.battery,
        on_set_aside=damaged.adding(boxes_lost.set),
    )
    swaps = SwapFile(data, battery.battery, simulated=is_simulated)

    # The pipeline of the live source, which goes on from what earlier runs learned; the replay has its own
    learned_path = data / learned_file(battery.battery.name, is_team=battery.battery == team_battery().battery)
    learned = load_learned_state(learned_path, battery.battery.n_cells)
    predictor = pipelines.predictor(None if learned is None else learned.cells)
    start_soc = None if learned is None else learned.start(clock.wall_ns())
    pipeline = pipelines.pipeline(source, serial_url, can_url, predictor=predictor, start_soc=start_soc)
    learned_state = LearnedStateSaver(learned_path, pipeline, predictor, clock)
    hub: Hub[Snapshot] = Hub()
    replay = ReplayPlayer(
        partial(pipelines_of, pipelines),
        cause_of_trip_at,
        hub.publish_threadsafe,
        partial(events.note, "warning", "replay-failed"),
        clock,
        open_file=catalogue.open_file,
    )

    # The links, and the configuration behind them
    failures = Failures(clock)
    inbox = Inbox(record=failures.caught(recorder.on_item))
    links = Links(
        serial_url,
        can_url,
        inbox.put,
        clock,
        can_fd=battery.uses_fd,
        may_transmit=source == "simulator" or settings.bench,
    )
    trace = CanTrace()
    rules = Rules(pipelines.cell, trace)
    config_history = ConfigHistory(data)
    write_log = WriteLog(config_history, events.note, clock)
    configuration = ConfigurationWriter(links.master, rules.context, write_log, clock)
    in_force = ConfigurationInForce(configuration, clock)
    profiles = Profiles(data / "profiles", clock)
    jobs = ThreadPoolExecutor(max_workers=1, thread_name_prefix="jobs")
    identification = MasterIdentification(links.master, configuration, jobs, clock)

    # What drives it all
    def record_output(output: Output, t_mono_ns: int) -> None:
        recorder.on_output(output)

    def publish_output(output: Output, t_mono_ns: int) -> None:
        if mqtt is not None and output.snapshot is not None:
            mqtt.offer(output.snapshot)

    load = Load(lambda: recorder.commit_delay_s, clock, recorder.wait_for_commit)
    live = PipelineThread(
        pipeline,
        inbox,
        hub,
        replay,
        clock,
        failures=failures,
        load=load,
        on_item=(trace.on_item, identification.on_item),
        on_output=(
            events.on_output,
            record_output,
            in_force.on_output,
            publish_output,
            black_boxes.on_output,
        ),
        after_publishing=(learned_state.on_output,),
    )

    def live_waits() -> bool:
        age_s = None if live.snapshot is None else aged(live.snapshot, clock.monotonic_ns()).age_s.voltage
        return age_s is not None and STALE_S <= age_s < GONE_S

    def ids_of_others() -> set[int]:
        """CAN ids that the battery's master or BMS sends or listens to, or that were heard of anybody."""
        heard = {can_id for can_id, traced in trace.by_id().items() if not traced.latest.sent}
        if battery.speaks_dbc is not None:
            return heard | set(battery.definitions.by_id())
        return heard | ids_of(in_force.image() or default_image())

    followers = [
        Follower(
            remote,
            sessions_folder,
            clock,
            order=settings.recorder_order,
            live_waits=live_waits,
            note=partial(events.note, "info", "session-fetched"),
            catalogue=catalogue,
        )
        for remote in remotes_of(settings.recorder, settings.recorder_secret, settings.trust)
    ]
    return Service(
        settings=settings,
        clock=clock,
        battery=battery,
        events=events,
        links=links,
        driver_display=DriverDisplay(
            links.send_can,
            lambda: live.snapshot,
            ids_of_others,
            clock,
        ),
        live=live,
        trace=trace,
        pipelines=pipelines,
        replay=replay,
        recorder=recorder,
        catalogue=catalogue,
        retention=retention,
        season=season,
        season_source=lambda: SeasonSource(
            season.place, battery.battery, is_simulated, pipelines.cell, tuple(swaps.read())
        ),
        fetches=FetchJobs(sessions_folder, catalogue, events.note, clock),
        followers=Followers(followers),
        imports=ImportJobs(data, pipelines.for_import, events.note, workers, battery),
        swaps=swaps,
        black_boxes=black_boxes,
        boxes_of_sessions=BlackBoxesOfSessions(
            catalogue, black_boxes.store, is_simulated=is_simulated, lost=boxes_lost
        ),
        configuration=configuration,
        in_force=in_force,
        rules=rules,
        config_history=config_history,
        write_log=write_log,
        config_sources=ConfigSources(configuration, in_force.image, profiles, config_history, catalogue),
        profiles=profiles,
        slave_checks=SlaveCheckLog(data),
        commands=MasterCommands(links, events, write_log),
        learned_state=learned_state,
        mqtt=mqtt,
        health=Health(live, links, recorder, events, mqtt, clock, load, damaged),
        state=ServiceStateReader(recorder, replay, events, in_force, ClockRun(clock)),
        workers=workers,
        reading=reading,
        jobs=jobs,
    )
