// The live stream: a websocket that reconnects automatically. While one is silent another one is tried: over a radio
// with seconds of delay a connection is silent for long before its first message, and the first one with a message is
// used. A browser connects one websocket to an address at a time, so that one lost packet blocks all of them: while none
// receives, single snapshots are requested too, several at once.

import { get } from './rest';
import type { Snapshot } from './types';

export type Connection = 'connecting' | 'open' | 'lost' | 'refused';

export interface SocketLike {
  onmessage: ((event: { data: unknown }) => void) | null;
  onopen: ((event: unknown) => void) | null;
  onclose: ((event: { code: number }) => void) | null;
  readonly readyState?: number;
  close(): void;
}

const CONNECTING = 0; // a socket's readyState

export interface SocketEnvironment {
  connect: (url: string) => SocketLike;
  ask: () => Promise<Snapshot>;
  later: (action: () => void, ms: number) => number;
  cancel: (timer: number) => void;
  random: () => number;
}

const FIRST_WAIT_MS = 250;
const LONGEST_WAIT_MS = 2000; // of a radio that is there for seconds, none may be slept away
const SILENCE_MS = 4000; // the service sends once a second even when the master does not
const LONGER_MS = 8000; // between further ones: to connect takes four ways, and what a radio loses is sent again later
const MOST_TRIED = 3; // at a time: each has 20 s to speak
const ASK_EVERY_MS = 1000;
const MOST_ASKED = 4; // at a time: a browser has six connections to an address
const ASK_MS = 10_000;
const NOT_LOGGED_IN = 4401;

/** Milliseconds before attempt `n` (from 0): doubling to a cap, with jitter of half of it. */
export function backoffMs(attempt: number, random: number): number {
  const full = Math.min(LONGEST_WAIT_MS, FIRST_WAIT_MS * 2 ** Math.min(attempt, 10));
  return full / 2 + (full / 2) * random;
}

const browser: SocketEnvironment = {
  connect: (url) => new WebSocket(url) as unknown as SocketLike,
  ask: () => get<Snapshot>('snapshot', AbortSignal.timeout(ASK_MS)),
  later: (action, ms) => window.setTimeout(action, ms),
  cancel: (timer) => window.clearTimeout(timer),
  random: Math.random,
};

/** Opens the stream, hands over snapshots, reconnects until stopped. */
export class LiveSocket {
  private sockets: SocketLike[] = []; // the oldest first; more than one while none of them receives
  private active: SocketLike | null = null; // the one that received last
  private timer: number | null = null;
  private attempt = 0;
  private reported: Connection | null = null;
  private stopped = true;
  private asking: number | null = null; // the timer, while nothing is received
  private asked = 0; // on their way
  private newest = -Infinity; // time of the newest snapshot

  constructor(
    private readonly url: string,
    private readonly onSnapshot: (snapshot: Snapshot) => void,
    private readonly onConnection: (state: Connection) => void,
    private readonly around: SocketEnvironment = browser,
  ) {}

  start(): void {
    this.stopped = false;
    this.attempt = 0;
    this.reported = null;
    this.report('connecting');
    this.open();
  }

  stop(): void {
    this.stopped = true;
    this.clearTimer();
    this.endAsking();
    this.active = null;
    for (const socket of this.sockets.slice()) this.drop(socket);
  }

  private open(): void {
    const socket = this.around.connect(this.url);
    this.sockets.push(socket);
    if (this.sockets.length > MOST_TRIED) this.drop(this.sockets[0]!);
    this.watch();
    socket.onopen = () => {
      if (this.active === null) this.report('open');
    };
    socket.onmessage = (event) => {
      if (this.active !== socket) this.takeOver(socket);
      for (const other of this.sockets.slice()) if (other !== socket) this.drop(other);
      this.attempt = 0;
      this.endAsking();
      this.watch();
      if (typeof event.data === 'string') this.hand(JSON.parse(event.data) as Snapshot);
    };
    socket.onclose = (event) => {
      this.drop(socket);
      if (event.code === NOT_LOGGED_IN) {
        this.stop();
        this.report('refused');
      } else if (!this.sockets.length && !this.stopped) {
        this.report('lost');
        if (this.hasAnswered) this.asking ??= this.around.later(() => this.ask(), ASK_EVERY_MS);
        this.later(() => this.retry(), backoffMs(this.attempt++, this.around.random()));
      }
    };
  }

  /** What was missed while nothing spoke is asked for, as after a line that was lost. */
  private takeOver(socket: SocketLike): void {
    if (this.active !== null) this.report('lost');
    this.active = socket;
    this.report('open');
  }

  private watch(): void {
    const isSilent = this.sockets.length > 1;
    if (isSilent && this.hasAnswered && this.asking === null) this.ask();
    this.later(() => this.open(), isSilent ? LONGER_MS : SILENCE_MS);
  }

  /** Ask for single snapshots until a connection receives or the stream is stopped. */
  private ask(): void {
    this.asking = this.around.later(() => this.ask(), ASK_EVERY_MS);
    if (this.asked >= MOST_ASKED) return;
    this.asked++;
    this.around
      .ask()
      .then((snapshot) => {
        if (this.asking === null || snapshot.time <= this.newest) return;
        this.report('open');
        this.hand(snapshot);
      })
      .catch(() => undefined) // it did not arrive: another one is asked for
      .finally(() => this.asked--);
  }

  /** Before that the service may have none to give. */
  private get hasAnswered(): boolean {
    return this.newest > -Infinity;
  }

  private endAsking(): void {
    if (this.asking !== null) this.around.cancel(this.asking);
    this.asking = null;
  }

  private hand(snapshot: Snapshot): void {
    this.newest = snapshot.time;
    this.onSnapshot(snapshot);
  }

  private retry(): void {
    this.report('connecting');
    this.open();
  }

  private drop(socket: SocketLike): void {
    this.sockets = this.sockets.filter((each) => each !== socket);
    socket.onopen = socket.onmessage = socket.onclose = null;
    if (socket.readyState === CONNECTING)
      socket.onopen = () => socket.close(); // before, browsers report an error
    else socket.close();
    if (this.active !== socket) return;
    this.active = null;
    if (this.sockets.length) this.report('lost');
  }

  private report(state: Connection): void {
    if (state !== this.reported) this.onConnection(state);
    this.reported = state;
  }

  private later(action: () => void, ms: number): void {
    this.clearTimer();
    this.timer = this.around.later(action, ms);
  }

  private clearTimer(): void {
    if (this.timer !== null) this.around.cancel(this.timer);
    this.timer = null;
  }
}

/** The stream's address for the page's own origin. */
export function liveUrl(place: { protocol: string; host: string }): string {
  return `${place.protocol === 'https:' ? 'wss' : 'ws'}://${place.host}/api/v1/live`;
}
