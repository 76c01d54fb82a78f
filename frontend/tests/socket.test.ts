import { beforeEach, describe, expect, it } from 'vitest';
import type { Snapshot } from '../src/link/types';
import { backoffMs, LiveSocket, liveUrl, type Connection, type SocketLike } from '../src/link/socket';

class FakeSocket implements SocketLike {
  onmessage: ((event: { data: unknown }) => void) | null = null;
  onopen: ((event: unknown) => void) | null = null;
  onclose: ((event: { code: number }) => void) | null = null;
  closed = false;
  readyState?: number;
  close(): void {
    this.closed = true;
  }
}

let sockets: FakeSocket[];
let timers: Map<number, { action: () => void; ms: number }>;
let states: Connection[];
let seen: number[];
let answers: ((snapshot: Snapshot) => void)[]; // of the single snapshots that were asked for

function start(): LiveSocket {
  let id = 0;
  const live = new LiveSocket(
    'ws://car/api/v1/live',
    (s) => seen.push(s.seq),
    (state) => states.push(state),
    {
      connect: () => {
        const socket = new FakeSocket();
        sockets.push(socket);
        return socket;
      },
      ask: () => new Promise((resolve) => answers.push(resolve)),
      later: (action, ms) => {
        timers.set(++id, { action, ms });
        return id;
      },
      cancel: (timer) => void timers.delete(timer),
      random: () => 1,
    },
  );
  live.start();
  return live;
}

/** Let the timer that was set last go off; single snapshots are asked for by one that was set before it. */
function elapse(which = -1): number {
  const [id, { action, ms }] = [...timers].at(which)!;
  timers.delete(id);
  action();
  return ms;
}

beforeEach(() => {
  sockets = [];
  timers = new Map();
  states = [];
  seen = [];
  answers = [];
});

describe('LiveSocket', () => {
  it('hands over snapshots and reports that it is open', () => {
    start();
    sockets[0]!.onopen!({});
    sockets[0]!.onmessage!({ data: '{"seq":7}' });
    expect(seen).toEqual([7]);
    expect(states).toEqual(['connecting', 'open']);
  });

  it('comes back by itself, waiting longer each time up to a cap', () => {
    start();
    const waits = Array.from({ length: 7 }, () => {
      sockets.at(-1)!.onclose!({ code: 1006 });
      return elapse();
    });
    expect(waits).toEqual([250, 500, 1000, 2000, 2000, 2000, 2000]);
    expect(sockets).toHaveLength(8);
  });

  it('waits briefly again once it has heard something', () => {
    start();
    for (let i = 0; i < 4; i++) {
      sockets.at(-1)!.onclose!({ code: 1006 });
      elapse();
    }
    sockets.at(-1)!.onmessage!({ data: '{"seq":1}' });
    sockets.at(-1)!.onclose!({ code: 1006 });
    expect(elapse()).toBe(250);
  });

  it('tries another line beside one that is silent, and keeps the one that speaks first', () => {
    start();
    sockets[0]!.onopen!({});
    sockets[0]!.onmessage!({ data: '{"seq":1}' });
    expect(elapse()).toBe(4000);
    expect(sockets.map((each) => each.closed)).toEqual([false, false]);
    sockets[0]!.onmessage!({ data: '{"seq":2}' });
    expect(sockets.map((each) => each.closed)).toEqual([false, true]);
    expect(states).toEqual(['connecting', 'open']);
    elapse();
    sockets[2]!.onopen!({});
    sockets[2]!.onmessage!({ data: '{"seq":3}' });
    expect(sockets.map((each) => each.closed)).toEqual([true, true, false]);
    expect(states).toEqual(['connecting', 'open', 'lost', 'open']);
    expect(seen).toEqual([1, 2, 3]);
  });

  it('gives a line over a radio that is late by seconds twenty of them to speak', () => {
    start();
    const waits = [elapse(), elapse()];
    expect(sockets[0]!.closed).toBe(false);
    waits.push(elapse());
    expect(waits).toEqual([4000, 8000, 8000]);
    expect(sockets.map((each) => each.closed)).toEqual([true, false, false, false]);
    sockets[1]!.onopen!({});
    sockets[1]!.onmessage!({ data: '{"seq":1}' });
    expect(seen).toEqual([1]);
  });

  it('calls a line lost that said something, and is given up', () => {
    start();
    sockets[0]!.onmessage!({ data: '{"seq":1}' });
    for (let i = 0; i < 3; i++) elapse();
    expect(states.at(-1)).toBe('lost');
  });

  it('asks for single snapshots, some at once, until a line speaks', async () => {
    const answer = async (seq: number, time: number): Promise<void> => {
      answers.shift()!({ seq, time } as Snapshot);
      await Promise.resolve();
    };
    start();
    sockets[0]!.onmessage!({ data: '{"seq":1,"time":10}' });
    elapse();
    expect(answers).toHaveLength(1);
    elapse(0);
    for (let i = 0; i < 5; i++) elapse();
    expect(answers).toHaveLength(4);
    await answer(2, 11);
    await answer(1, 10.5);
    expect(seen).toEqual([1, 2]);
    expect(states.at(-1)).toBe('open');
    sockets.at(-1)!.onmessage!({ data: '{"seq":3,"time":12}' });
    await answer(4, 13);
    expect(seen).toEqual([1, 2, 3]);
    expect(timers.size).toBe(1);
  });

  it('does not ask again where a login is needed', () => {
    start();
    sockets[0]!.onclose!({ code: 4401 });
    expect(states.at(-1)).toBe('refused');
    expect(timers.size).toBe(0);
  });

  it('stays stopped', () => {
    const live = start();
    live.stop();
    expect(sockets[0]!.closed).toBe(true);
    expect(timers.size).toBe(0);
  });

  it('is closed once it is connected where it was dropped before, which browsers report as an error', () => {
    const live = start();
    sockets[0]!.readyState = WebSocket.CONNECTING;
    live.stop();
    expect(sockets[0]!.closed).toBe(false);
    sockets[0]!.onopen!({});
    expect(sockets[0]!.closed).toBe(true);
  });

  it('spreads the retries of many pages', () => {
    expect(backoffMs(3, 0)).toBe(1000);
    expect(backoffMs(3, 1)).toBe(2000);
  });

  it('uses the page’s own origin', () => {
    expect(liveUrl({ protocol: 'https:', host: 'pit:8000' })).toBe('wss://pit:8000/api/v1/live');
    expect(liveUrl({ protocol: 'http:', host: '127.0.0.1:8000' })).toBe('ws://127.0.0.1:8000/api/v1/live');
  });
});
