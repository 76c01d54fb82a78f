import { render } from 'svelte/server';
import type { Component } from 'svelte';
import { afterAll, beforeAll, describe, expect, it } from 'vitest';
import { message } from '../fixtures/battery';
import { makeSnapshot } from '../fixtures/snapshot';
import type { Alarm, Snapshot, TripCause } from '../src/link/types';

const TRIPPED = 63; // pack 6, cell 4
const RESTING = makeSnapshot('drive', 0, 1000, 1); // every voltage is what it should be again
const CAUSE = {
  code: 'joint-resistance-high',
  message: message('high-resistance busbar joint at pack 6, cell 4, 13.99 mΩ'),
  cell: TRIPPED,
  pack: null,
  confidence: 0.83,
} as TripCause;
const TRIP: Alarm = {
  ...makeSnapshot('fault', 0, 1000, 1).alarms[0]!,
  code: 'master-fault',
  message: message('shutdown circuit open: cell undervoltage'),
  cell: TRIPPED,
  value: 1.8413,
  cause: CAUSE,
};

describe('a trip that is still open', () => {
  let live: typeof import('../src/store/live.svelte').live;
  let causeText: typeof import('../src/store/alarms.svelte').causeText;
  let tripText: typeof import('../src/store/alarms.svelte').tripText;
  let body: (file: string, props?: Record<string, unknown>) => Promise<string>;
  beforeAll(async () => {
    Object.assign(globalThis, { location: { hash: '' }, localStorage: { getItem: () => null } });
    ({ live } = await import('../src/store/live.svelte'));
    ({ causeText, tripText } = await import('../src/store/alarms.svelte'));
    const { user } = await import('../src/store/user.svelte');
    const { shapes, Shape } = await import('../src/store/shape.svelte');
    const { BATTERY } = await import('../fixtures/battery');
    shapes.live = new Shape(BATTERY);
    user.me = { role: 'engineer', name: null, password_required: false, has_chief: false };
    live.connection = 'open';
    live.now = 0;
    const views = import.meta.glob<{ default: Component }>('../src/**/*.svelte');
    body = async (file, props = {}) => render((await views[`../src/${file}`]!()).default, { props }).body;
  });
  afterAll(() => {
    live.snapshot = null;
    live.connection = 'connecting';
  });
  const showing = (over: Partial<Alarm>, lowest: Partial<Snapshot['accumulator']> = {}): void => {
    const accumulator = { ...RESTING.accumulator, ...lowest };
    live.snapshot = { ...RESTING, accumulator, alarms: [{ ...TRIP, ...over }] };
  };

  it('names its cell once, and keeps each unit with its number', () => {
    expect(causeText(CAUSE, TRIP)).toBe('high-resistance busbar joint, 13.99\u00a0mΩ');
    expect(causeText({ ...CAUSE, cell: 64 }, TRIP)).toBe(
      'high-resistance busbar joint at pack 6, cell 4, 13.99\u00a0mΩ',
    );
    expect(causeText(CAUSE, { ...TRIP, cells: [TRIPPED, 64] })).toContain('at pack 6, cell 4');
  });

  it('says in two parts that the circuit is open, and why', () => {
    expect(tripText(TRIP)).toEqual(['shutdown circuit open: ', 'cell undervoltage']);
    const own = { ...TRIP, code: 'pack-voltage-high', message: message('pack 3: voltage above its limit') };
    expect(tripText(own)).toEqual(['', 'pack 3: voltage above its limit']);
  });

  it('covers the bar until somebody acknowledges it', async () => {
    showing({});
    const open = await body('parts/TopBar.svelte');
    expect(open).toMatch(/class="bar[^"]* new/);
    expect(open).toContain('high-resistance busbar joint, 13.99');
    expect(open).toMatch(/Acknowledge<\/button>/);
    showing({ acknowledged_by: 'kari' });
    const seen = await body('parts/TopBar.svelte');
    expect(seen).toMatch(/class="bar[^"]* tripped/);
    expect(seen).not.toMatch(/class="bar[^"]* new/);
    expect(seen).toContain('data-testid="trip-box"');
    expect(seen).not.toMatch(/Acknowledge<\/button>/);
  });

  it('marks its cell on the map by the colour of trips, whatever its voltage is now', async () => {
    for (const over of [{}, { acknowledged_by: 'kari' }]) {
      showing(over);
      const { metricById } = await import('../src/store/metrics');
      const map = await body('parts/HeatMap.svelte', { metric: metricById('voltage') });
      const cell = (i: number): string => new RegExp(`<a[^>]*data-testid="cell-${i}"[^>]*>`).exec(map)![0];
      expect(cell(TRIPPED)).toMatch(/class="cell[^"]* tripped/);
      expect(cell(TRIPPED)).not.toContain('background-color');
      expect(cell(TRIPPED - 1)).toContain('background-color');
    }
  });

  it('keeps the weakest cell under load next to the lowest one now', async () => {
    const lowest = { voltage_v: 1.8413, cell: TRIPPED, current_a: 147.2, time: 900 };
    showing({}, { lowest_under_load: lowest, voltage_min_v: 3.969, voltage_min_cell: 30 });
    for (const file of ['views/overview/Extremes.svelte', 'views/Packs.svelte']) {
      const shown = await body(file);
      const loaded = shown.slice(shown.indexOf('data-testid="lowest-under-load"'));
      expect(shown, file).toMatch(/Lowest now[^]*3\.9690[^]*pack 3, cell 7/);
      expect(loaded, file).toMatch(/1\.8413[^]*pack 6, cell 4[^]*147(&nbsp;|\s)A/);
    }
    showing({}, { lowest_under_load: null });
    expect(await body('views/overview/Extremes.svelte')).toMatch(/data-testid="v-loaded"[^]*?–/);
  });
});
