// The live stream: one websocket that comes back by itself, with a watchdog for a silent line.

import { rootOf } from './root';
import type { Snapshot } from './types';

export type Connection = 'connecting' | 'open' | 'lost' | 'refused';

export interface SocketLike {
  onmessage: ((event: { data: unknown }) => void) | null;
  onopen: ((event: unknown) => void) | null;
  onclose: ((event: { code: number }) => void) | null;
  close(): void;
}

export interface SocketEnvironment {
  connect: (url: string) => SocketLike;
  later: (action: () => void, ms: number) => number;
  cancel: (timer: number) => void;
  random: () => number;
}

const FIRST_WAIT_MS = 250;
const LONGEST_WAIT_MS = 5000;
const SILENCE_MS = 4000; // the service speaks once a second even when the master does not
const NOT_LOGGED_IN = 4401;

/** Milliseconds before attempt `n` (from 0): doubling to a cap, with jitter of half of it. */
export function backoffMs(attempt: number, random: number): number {
  const full = Math.min(LONGEST_WAIT_MS, FIRST_WAIT_MS * 2 ** Math.min(attempt, 10));
  return full / 2 + (full / 2) * random;
}

const browser: SocketEnvironment = {
  connect: (url) => new WebSocket(url) as unknown as SocketLike,
  later: (action, ms) => window.setTimeout(action, ms),
  cancel: (timer) => window.clearTimeout(timer),
  random: Math.random,
};

/** Opens the stream, hands over snapshots, reconnects until stopped. */
export class LiveSocket {
  private socket: SocketLike | null = null;
  private timer: number | null = null;
  private attempt = 0;
  private stopped = true;

  constructor(
    private readonly url: string,
    private readonly onSnapshot: (snapshot: Snapshot) => void,
    private readonly onConnection: (state: Connection) => void,
    private readonly around: SocketEnvironment = browser,
  ) {}

  start(): void {
    this.stopped = false;
    this.attempt = 0;
    this.open();
  }

  stop(): void {
    this.stopped = true;
    this.clearTimer();
    this.drop();
  }

  private open(): void {
    this.clearTimer();
    this.onConnection('connecting');
    const socket = this.around.connect(this.url);
    this.socket = socket;
    this.watch();
    socket.onopen = () => {
      this.onConnection('open');
      this.watch();
    };
    socket.onmessage = (event) => {
      this.attempt = 0;
      this.watch();
      if (typeof event.data === 'string') this.onSnapshot(JSON.parse(event.data) as Snapshot);
    };
    socket.onclose = (event) => {
      if (this.socket !== socket) return;
      this.socket = null;
      if (event.code === NOT_LOGGED_IN) {
        this.clearTimer();
        this.onConnection('refused');
      } else {
        this.retry();
      }
    };
  }

  private watch(): void {
    this.clearTimer();
    this.timer = this.around.later(() => {
      this.drop();
      this.retry();
    }, SILENCE_MS);
  }

  private retry(): void {
    if (this.stopped) return;
    this.clearTimer();
    this.onConnection('lost');
    this.timer = this.around.later(() => this.open(), backoffMs(this.attempt++, this.around.random()));
  }

  private drop(): void {
    const socket = this.socket;
    this.socket = null;
    if (!socket) return;
    socket.onopen = socket.onmessage = socket.onclose = null;
    socket.close();
  }

  private clearTimer(): void {
    if (this.timer !== null) this.around.cancel(this.timer);
    this.timer = null;
  }
}

/** The stream's address for the page's own origin, and its battery. */
export function liveUrl(place: { protocol: string; host: string; pathname?: string }): string {
  const root = rootOf(place.pathname ?? '/');
  return `${place.protocol === 'https:' ? 'wss' : 'ws'}://${place.host}${root}api/v1/live`;
}
