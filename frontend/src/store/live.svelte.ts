// The one place that holds what is known now: the latest snapshot, when it came, and the history behind it.
// Views read it; only the socket writes it. The page's own clock makes ages grow while nothing arrives.

import { LiveSocket, liveUrl, type Connection } from '../link/socket';
import { get } from '../link/rest';
import type { History, Link, Maybe, Part, Snapshot } from '../link/types';
import { STALE_S, freshness, isLive, type Freshness } from '../format';
import { FrameSchedule, MinimumDelay } from './frame_schedule';
import { Ring } from './ring';

export const SERIES = [
  'voltage_v',
  'current_a',
  'power_w',
  'soc',
  'voltage_min_v',
  'voltage_max_v',
  'temperature_min_degc',
  'temperature_max_degc',
] as const;
export type SeriesName = (typeof SERIES)[number];

const PARTS: Record<SeriesName, Part> = {
  voltage_v: 'voltage',
  current_a: 'current',
  power_w: 'current',
  soc: 'voltage',
  voltage_min_v: 'voltage',
  voltage_max_v: 'voltage',
  temperature_min_degc: 'temperature',
  temperature_max_degc: 'temperature',
};

const HISTORY_S = 900;
const QUIET_S = 2.5; // the service sends once a second even when the master does not
const CLOSED = new Set<Link['state']>(['off', 'connecting', 'lost']);
const HISTORY_SAMPLES = 30 * HISTORY_S;

class Live {
  snapshot = $state.raw<Snapshot | null>(null);
  connection = $state<Connection>('connecting');
  now = $state(performance.now() / 1000);
  beat = $state(0); // of the charts
  readonly ring = new Ring(HISTORY_SAMPLES, SERIES.length);
  latest: Snapshot | null = null;
  private readonly listeners = new Set<(snapshot: Snapshot) => void>();
  private receivedAt = 0;
  private waited = 0; // of the newest message, on its way to here
  private readonly way = new MinimumDelay();
  private readonly pace = new FrameSchedule();
  private frameAsked = false;
  private nextTick: number | undefined;
  private backfilled = false;
  private socket: LiveSocket | null = null;

  start(): void {
    this.socket ??= new LiveSocket(
      liveUrl(location),
      (snapshot) => this.take(snapshot),
      (state) => this.connected(state),
    );
    this.socket.start();
    this.askFrame();
  }

  restart(): void {
    this.socket?.stop();
    this.socket?.start();
  }

  /** Call `listener` with every snapshot until the returned closure is called. */
  onSnapshot(listener: (snapshot: Snapshot) => void): () => void {
    this.listeners.add(listener);
    return () => this.listeners.delete(listener);
  }

  /** Seconds since the master measured a part, grown by the snapshot's way to here and the time since. */
  age(part: Part): Maybe<number> {
    const age = this.snapshot?.age[part] ?? null;
    return age === null ? null : age + this.late;
  }

  freshness(part: Part): Freshness {
    return freshness(this.age(part), this.snapshot?.live_s?.[part] ?? STALE_S);
  }

  /** Whether what is shown comes from the simulator: training data must never be taken for the car. */
  get simulated(): boolean {
    return this.snapshot?.source === 'simulator';
  }

  /** The service is gone, or blocked: what is shown is the last that was received. */
  get gone(): boolean {
    return this.connection === 'lost' || this.behind > QUIET_S;
  }

  /** The service answers, so what asks it for something can work. */
  get answers(): boolean {
    return this.connection === 'open' && !this.gone;
  }

  /** A command can reach the master: the service answers, its RS232 port is open and the snapshot is no replay's. */
  get commands(): boolean {
    const { snapshot } = this;
    return this.answers && snapshot !== null && !snapshot.replay && !CLOSED.has(snapshot.links.rs232.state);
  }

  /** Seconds since the service sent what is shown. */
  get late(): number {
    return this.waited + this.behind;
  }

  /** Seconds since the last message from the service. */
  get behind(): number {
    return Math.max(0, this.now - this.receivedAt);
  }

  /** The service's wall clock, carried on by the page's. */
  get time(): number {
    return (this.snapshot?.time ?? Date.now() / 1000) + (this.snapshot ? this.behind : 0);
  }

  /** Seconds since an instant of the service's clock. */
  since(time: number): number {
    return Math.max(0, (this.snapshot?.time ?? time) - time) + this.late;
  }

  private take(snapshot: Snapshot): void {
    this.latest = snapshot;
    this.askFrame();
    this.receivedAt = performance.now() / 1000;
    this.waited = snapshot.sent_s === null ? 0 : this.way.of(snapshot.run, snapshot.sent_s, this.receivedAt);
    if (!this.backfilled) void this.backfill(snapshot.time);
    const { accumulator, age } = snapshot;
    const row = SERIES.map((name) =>
      isLive(older(age[PARTS[name]], this.waited)) ? accumulator[name] : null,
    );
    if (row.some((value) => value !== null)) this.ring.push(snapshot.time, row); // what is only older is no sample
    for (const listener of this.listeners) listener(snapshot);
  }

  private connected(state: Connection): void {
    this.connection = state;
    if (state === 'lost') this.backfilled = false;
  }

  /** Ask for what was before the first snapshot, since the last that is known: what is live comes first. */
  private async backfill(now: number): Promise<void> {
    this.backfilled = true;
    const known = this.ring.lastTime;
    const missing = Math.min(HISTORY_S, Math.max(1, Math.ceil(now - known)));
    const from = known < now ? known : -Infinity; // a service whose clock was set back is asked for all
    try {
      const past = await get<History>(`history?seconds=${from === -Infinity ? HISTORY_S : missing}`);
      const columns = SERIES.map((name) => past.series[name] ?? []);
      const here = this.ring.since(-Infinity);
      const own = Array.from(here.time, (time, i) => ({ time, row: here.values.map((v) => v[i]!) }));
      const recorded = past.time.map((time, i) => ({
        time,
        row: columns.map((column) => column[i] ?? null),
      }));
      const last = past.time.at(-1) ?? -Infinity;
      const before = own.filter(({ time }) => time <= from);
      this.ring.clear();
      for (const { time, row } of [...before, ...recorded.filter((each) => each.time > from)])
        this.ring.push(time, row);
      for (const { time, row } of own) if (time > last) this.ring.push(time, row);
    } catch {
      return; // the next connection asks again
    }
  }

  /** Frames are asked for where there is something to draw: the browser sleeps in between, and a battery lasts. */
  private askFrame(): void {
    window.clearTimeout(this.nextTick);
    if (this.frameAsked) return;
    this.frameAsked = true;
    requestAnimationFrame(this.frame);
  }

  private readonly frame = (stamp: number): void => {
    this.frameAsked = false;
    const step = this.pace.next(stamp, this.latest !== this.snapshot);
    if (step === 'numbers') {
      this.snapshot = this.latest;
      this.now = stamp / 1000;
    } else if (step === 'charts') {
      this.beat++;
    }
    const pause = this.pace.pause(stamp, this.latest !== this.snapshot);
    if (pause > 0) this.nextTick = window.setTimeout(() => this.askFrame(), pause);
    else this.askFrame();
  };
}

const older = (age: Maybe<number>, by: number): Maybe<number> => (age === null ? null : age + by);

export const live = new Live();
