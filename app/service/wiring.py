"""Makes the parts of the service and connects them, in the order in which they need each other.

Items flow from the links through the inbox and the pipeline to the listeners, called in the order of this file.
"""

import time
from functools import partial

from app.analysis.black_box.from_session import STORE, BlackBoxesOfSessions
from app.analysis.black_box.recorder import BlackBoxRecorder
from app.analysis.replay import cause_of_trip_at, pipelines_of
from app.clock import Clock, ClockRun
from app.estimation.cell_model.cell_file import format_cell
from app.live.can_trace import CanTrace
from app.live.hub import Hub
from app.live.load_shedding import LoadShedding
from app.live.pipeline_factory import PipelineFactory
from app.season.season_lake import SeasonLake
from app.service.events import Events
from app.service.failures import Failures
from app.service.health.checks import DamagedFiles, Health
from app.service.host import is_clock_synchronised
from app.service.inbox import Inbox
from app.service.learned_state_saver import learning_pipeline
from app.service.links import ServiceLinks
from app.service.master import MasterCommands, MasterIdentification, Rules, ids_of_others, master_configuration
from app.service.mqtt.publisher import configured_publisher
from app.service.pipeline_thread import PipelineThread
from app.service.service import Service
from app.service.session_watch import SessionWatch
from app.service.settings import Settings
from app.service.state import ServiceStateReader, recording_state
from app.service.trip_explanation import TripExplanation
from app.sessions.catalogue import Catalogue
from app.sessions.event_log import EventLog
from app.sessions.limited_reader import LimitedReader
from app.sessions.recording.auto_recorder import AutoRecorder
from app.sessions.recording.disk import DiskLimits
from app.sessions.replay import ReplayPlayer
from app.sessions.retention import Retention, RetentionRule
from app.sessions.swaps import SwapFile
from app.sessions.transfer.fetch_jobs import FetchJobs
from app.sessions.transfer.follow import Follower, Followers, remotes_of
from app.sessions.transfer.import_jobs import ImportJobs
from app.sessions.worker import Workers
from app.sources.links.driver_display import DriverDisplay
from app.sources.loaded_battery import load_battery
from app.telemetry import Snapshot, Source


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
    battery = load_battery(settings.battery)
    events = Events(EventLog(data / "events.sqlite", clock, damaged.add, battery.battery.segments), clock)
    damaged.note_into(events.note)
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
    mqtt = configured_publisher(settings, partial(recording_state, recorder), clock, source, battery.battery)
    events.subscribe(recorder.on_event)
    if mqtt is not None:
        events.subscribe(mqtt.offer_event)

    # Sessions on the disk
    reading = Workers()  # for itself, so that a list waits for no export
    limited = LimitedReader(reading, (battery.files, format_cell(pipelines.cell)))
    events.subscribe(limited.on_event)
    catalogue = Catalogue(sessions_folder, limited)
    retention = Retention(
        catalogue,
        RetentionRule(settings.keep_days, settings.keep_gb),
        lambda severity, message: events.note(severity, "session-expired", message),
        clock,
        is_clock_synchronised,
    )
    workers = Workers()
    season = SeasonLake(data, settings.lake, workers, builds=settings.season)
    events.subscribe(season.on_event)
    is_simulated = source == "simulator"
    pipeline, learned_state = learning_pipeline(data, pipelines, clock, source, serial_url, can_url)
    explanation = TripExplanation(recorder, catalogue, pipeline, pipelines.cell, events, clock)
    session_watch = SessionWatch(recorder, catalogue, workers, pipeline, clock)
    black_boxes = BlackBoxRecorder(
        data / STORE,
        lambda: recorder.session_id,
        explanation.on_black_box,
        explanation.cause,
        is_simulated=is_simulated,
        battery=battery.battery,
        on_set_aside=damaged.add,
    )
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
    links = ServiceLinks(
        serial_url,
        can_url,
        inbox.put,
        clock,
        can_fd=battery.uses_fd,
        mapping=battery.serial,
        may_transmit=is_simulated or settings.bench,
    )
    trace = CanTrace()
    rules = Rules(pipelines.cell, trace)
    config = master_configuration(data, links.master, rules, catalogue, events.note, clock)
    identification = MasterIdentification(links.master, config.writer, clock)

    load = LoadShedding(lambda: recorder.commit_delay_s, clock, recorder.wait_for_commit)
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
            lambda output, _: recorder.on_output(output),
            config.in_force.on_output,
            *(() if mqtt is None else (mqtt.on_output,)),
            black_boxes.on_output,
            session_watch.on_output,
            learned_state.on_alarms,
        ),
        after_publishing=(learned_state.on_output,),
    )

    fetched = partial(events.note, "info", "session-fetched")
    followers = Followers(
        Follower(remote, sessions_folder, clock, settings.recorder_order, live.voltage_age_s, fetched, catalogue)
        for remote in remotes_of(settings.recorder, settings.recorder_secret, settings.trust)
    )
    others = partial(ids_of_others, trace, battery, config.in_force)
    return Service(
        settings=settings,
        clock=clock,
        battery=battery,
        events=events,
        links=links,
        driver_display=DriverDisplay(links.send_can, lambda: live.snapshot, others, clock),
        live=live,
        trace=trace,
        pipelines=pipelines,
        replay=replay,
        recorder=recorder,
        catalogue=catalogue,
        retention=retention,
        season=season,
        fetches=FetchJobs(sessions_folder, catalogue, events.note, clock),
        followers=followers,
        imports=ImportJobs(data, pipelines.for_import, events.note, workers, battery),
        swaps=SwapFile(data, battery.battery, simulated=is_simulated),
        black_boxes=black_boxes,
        session_watch=session_watch,
        boxes_of_sessions=BlackBoxesOfSessions(catalogue, black_boxes.store, is_simulated, black_boxes.lost),
        configuration=config,
        identification=identification,
        commands=MasterCommands(links, events, config.write_log),
        learned_state=learned_state,
        mqtt=mqtt,
        health=Health(live, links, recorder, events, mqtt, clock, load, damaged),
        state=ServiceStateReader(recorder, replay, events, config.in_force, ClockRun(clock)),
        workers=workers,
        reading=reading,
    )
