import { render } from 'svelte/server';
import { beforeAll, describe, expect, it } from 'vitest';
import type { LogEvent } from '../src/link/types';
import { momentOf } from '../src/store/events.svelte';

const event = (over: Partial<LogEvent>): LogEvent =>
  ({
    id: 1,
    time: 1000,
    code: 'v_min',
    severity: 'trip',
    cell: null,
    value: null,
    limit: null,
    unit: '',
    who: null,
    acknowledged_by: null,
    message: { code: '', args: {}, text: '' },
    ...over,
  }) as LogEvent;
const box = (
  id: string,
  time: number,
  cell: number | null,
): { id: string; time: number; cell: number | null } => ({
  id,
  time,
  cell,
});
const RUN = { id: 'run 1', started: 900, ended: 1100, duration_s: 200, recording: false };

describe('the moment of an event that tells of a black box', () => {
  const written = event({ code: 'blackbox', cell: 30 });

  it('is that box, though a recording has the moment too', () => {
    expect(momentOf(written, [box('trip 1', 990, 30)], [RUN])).toBe('#/sessions/box/trip%201');
  });

  it('is the newest box of its cell that was there by then', () => {
    const boxes = [
      box('later', 1001, 30),
      box('other', 998, 31),
      box('mine', 990, 30),
      box('before', 970, 30),
    ];
    expect(momentOf(written, boxes, [])).toBe('#/sessions/box/mine');
    expect(momentOf({ ...written, cell: null }, [box('car', 1000, null)], [])).toBe('#/sessions/box/car');
  });

  it('is the list of boxes where its own is not there any more', () => {
    expect(momentOf(written, [box('old', 900, 30)], [RUN])).toBe('#/sessions/boxes');
    expect(momentOf(written, [], [RUN])).toBe('#/sessions/boxes');
  });
});

describe('the moment of any other event', () => {
  it('is that of the recording, with the cell', () => {
    expect(momentOf(event({}), [box('trip', 1000, null)], [RUN])).toBe('#/sessions/run%201?at=1000.000');
    expect(momentOf(event({ cell: 30 }), [], [RUN])).toBe('#/sessions/run%201?at=1000.000&cell=30');
  });

  it('is in a recording that goes on, and in one that was not closed up to what it holds', () => {
    const open = { ...RUN, ended: null };
    expect(momentOf(event({ time: 5000 }), [], [{ ...open, recording: true }])).toMatch(/\?at=5000\.000$/);
    expect(momentOf(event({ time: 1099 }), [], [open])).toMatch(/\?at=1099\.000$/);
    expect(momentOf(event({ time: 1101 }), [], [open])).toBe('');
  });

  it('is nowhere where nothing was recorded', () => {
    expect(momentOf(event({ time: 899 }), [], [RUN])).toBe('');
    expect(momentOf(event({ time: 1101 }), [], [RUN])).toBe('');
  });
});

describe('a row of the log', () => {
  let events: typeof import('../src/store/events.svelte').events;
  let body: () => string;
  beforeAll(async () => {
    Object.assign(globalThis, { location: { hash: '' } });
    ({ events } = await import('../src/store/events.svelte'));
    const { default: Events } = await import('../src/views/Events.svelte');
    body = () => render(Events).body;
  });

  it('leads to the box, or nowhere where there is nothing to look at', () => {
    events.list = [event({ code: 'blackbox', cell: 30 })];
    expect(body()).toMatch(/<a href="#\/sessions\/boxes"[^>]*>Go to recording<\/a>/);
    events.list = [event({})];
    expect(body()).not.toContain('>Go to recording<');
    events.list = [];
  });
});
