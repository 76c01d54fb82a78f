import { render } from 'svelte/server';
import type { Component } from 'svelte';
import { beforeAll, describe, expect, it } from 'vitest';
import { makeSnapshot } from '../fixtures/snapshot';
import { freshness } from '../src/format';
import type { LastKnown, Snapshot } from '../src/link/types';
import { metricById } from '../src/store/metrics';

const NOW = 1000;
const SILENT_S = 180;
const LOST = [36, 37, 38, 39, 40, 41, 42, 43, 44, 45, 46, 47];

const live96 = (): Snapshot => makeSnapshot('drive', 0, NOW, 1);

const last = (value: number | null, time: number, cell?: number): { value: number; time: number } =>
  ({ value, time, ...(cell === undefined ? {} : { cell }) }) as { value: number; time: number };

/** What the service sends of a car that has been silent for three minutes. */
function silent(): Snapshot {
  const s = live96();
  const time = NOW - SILENT_S;
  const none = s.cells.voltage_v.map(() => null);
  const totals = Object.entries(s.accumulator).filter(([, v]) => typeof v === 'number');
  const known: LastKnown = {
    cells: {
      voltage_v: { values: s.cells.voltage_v, time },
      temperature_degc: { values: s.cells.temperature_degc, time },
      soc: { values: s.cells.soc, time },
    },
    packs: s.packs.map((p) => ({ voltage_v: last(p.voltage_v, time), min_v: last(p.min_v, time) })),
    accumulator: Object.fromEntries(totals.map(([name, v]) => [name, last(v as number, time, 7)])),
  };
  return {
    ...s,
    age: Object.fromEntries(Object.keys(s.age).map((part) => [part, SILENT_S])) as unknown as Snapshot['age'],
    cells: { ...s.cells, voltage_v: none, temperature_degc: none, soc: none },
    packs: s.packs.map((p) => ({ ...p, voltage_v: null, min_v: null, max_v: null, delta_v: null })),
    accumulator: {
      ...s.accumulator,
      ...Object.fromEntries(totals.map(([name]) => [name, null])),
      loaded_cells: 0,
    } as Snapshot['accumulator'],
    last_known: known,
  };
}

/** What it sends where one slave was lost three minutes ago. */
function half(): Snapshot {
  const s = live96();
  const time = NOW - SILENT_S;
  const only = (values: (number | null)[]): (number | null)[] =>
    values.map((v, i) => (LOST.includes(i) ? v : null));
  const without = (values: (number | null)[]): (number | null)[] =>
    values.map((v, i) => (LOST.includes(i) ? null : v));
  return {
    ...s,
    cells: { ...s.cells, voltage_v: without(s.cells.voltage_v) },
    packs: s.packs.map((p, i) => (i === 3 ? { ...p, voltage_v: null, min_v: null, max_v: null } : p)),
    accumulator: { ...s.accumulator, voltage_v: null, voltage_at_least_v: 340.4, loaded_cells: 84 },
    last_known: {
      cells: { voltage_v: { values: only(s.cells.voltage_v), time } },
      packs: s.packs.map((p, i) => (i === 3 ? { voltage_v: last(p.voltage_v, time) } : {})),
      accumulator: { voltage_v: last(389, time), voltage_mean_v: last(3.7, time) },
    },
  };
}

describe('what is not measured now', () => {
  let store: typeof import('../src/store/last_known');
  let state: typeof import('../src/store/live.svelte').live;
  let shapes: typeof import('../src/store/shape.svelte').shapes;
  let body: (file: string, props?: Record<string, unknown>) => Promise<string>;
  beforeAll(async () => {
    Object.assign(globalThis, { location: { hash: '' }, localStorage: { getItem: () => null } });
    store = await import('../src/store/last_known');
    ({ live: state } = await import('../src/store/live.svelte'));
    const { Shape, shapes: all } = await import('../src/store/shape.svelte');
    shapes = all;
    shapes.live = new Shape({ segments: Array<number>(8).fill(12) });
    state.now = 0;
    state.connection = 'open';
    const views = import.meta.glob<{ default: Component }>('../src/**/*.svelte');
    body = async (file, props = {}) => render((await views[`../src/${file}`]!()).default, { props }).body;
  });

  it('is what it last was, with its time', () => {
    const s = silent();
    const fresh = freshness(s.age.voltage);
    const cell = store.shownCell(s, fresh, 'voltage_v', 40);
    expect(cell).toMatchObject({
      value: live96().cells.voltage_v[40],
      since: NOW - SILENT_S,
      part: 'voltage',
    });
    const total = store.shownTotal(s, fresh, 'voltage_min_v');
    expect(total).toMatchObject({
      value: live96().accumulator.voltage_min_v,
      since: NOW - SILENT_S,
      cell: 7,
    });
    expect(store.shownPack(s, fresh, 'voltage_v', 3).since).toBe(NOW - SILENT_S);
  });

  it('is nothing where it was never measured', () => {
    const s = { ...silent(), last_known: null };
    expect(store.shownCell(s, 'blank', 'voltage_v', 40)).toMatchObject({
      value: null,
      since: null,
      cell: null,
    });
    expect(store.shownTotal(null, 'blank', 'soc')).toMatchObject({ value: null, since: null, cell: null });
  });

  it('has no time while it is measured', () => {
    const s = live96();
    expect(store.shownCell(s, 'live', 'voltage_v', 40).since).toBeNull();
    expect(store.shownCell(s, 'stale', 'voltage_v', 40).since).toBeNull();
    expect(store.shownTotal(s, 'live', 'voltage_v').since).toBeNull();
  });

  it('is the last answer where the service is gone', () => {
    const s = live96();
    const cell = store.shownCell(s, 'blank', 'voltage_v', 40);
    expect(cell).toMatchObject({
      value: s.cells.voltage_v[40],
      since: NOW - (s.age.voltage ?? NaN),
      cell: null,
    });
  });

  it('is not shown where the master reports a total without cells', () => {
    const s = silent();
    const by_can = {
      voltage_v: 370,
      soc: 0.8,
      driver_soc_percent: 80,
      soc_source: 'master',
      current_a: 5,
    } as const;
    const alive = {
      ...s,
      age: { ...s.age, current: 0.1, soc: 0.1 },
      accumulator: { ...s.accumulator, ...by_can },
    };
    expect(store.partOfTotal(alive, 'driver_soc_percent')).toBe('soc');
    expect(store.shownTotal(alive, 'live', 'driver_soc_percent')).toMatchObject({ value: 80, since: null });
    expect(store.shownTotal(alive, 'live', 'voltage_v')).toMatchObject({
      value: 370,
      since: null,
      part: 'current',
    });
    expect(store.shownTotal(alive, 'blank', 'soc_min').since).toBe(NOW - SILENT_S);
  });

  it('is no total next to cells that are measured', () => {
    const s = half();
    expect(store.shownTotal(s, 'live', 'voltage_v')).toMatchObject({ value: null, since: null, cell: null });
    expect(store.shownTotal(s, 'live', 'voltage_min_v').since).toBeNull();
    expect(store.shownCell(s, 'live', 'voltage_v', 40).since).toBe(NOW - SILENT_S);
    expect(store.shownCell(s, 'live', 'voltage_v', 35).since).toBeNull();
    expect(store.shownPack(s, 'live', 'voltage_v', 3).since).toBe(NOW - SILENT_S);
    expect(store.shownPack(s, 'live', 'voltage_v', 2).since).toBeNull();
  });

  it('deviates from the mean of its own moment', () => {
    const deviation = metricById('deviation');
    const lost = deviation.last(half().last_known!);
    expect(lost[40]).toBeCloseTo((live96().cells.voltage_v[40]! - 3.7) * 1000);
    expect(lost[35]).toBeNull();
    const { accumulator, ...known } = half().last_known!;
    const unknown = { ...known, accumulator: { ...accumulator, voltage_mean_v: null } };
    expect(deviation.last(unknown)[40]).toBeNull(); // the mean of twelve cells is none of all
  });

  it.each(['parts/CellTable.svelte', 'views/overview/Extremes.svelte', 'views/overview/Electrical.svelte'])(
    'is drawn in grey and with no mark: %s',
    async (file) => {
      state.snapshot = silent();
      const text = await body(file);
      expect(text).toContain('known');
      expect(text).not.toMatch(/class="[^"]*\b(low|high)\b/);
      state.snapshot = live96();
      expect(await body(file)).not.toContain('known');
    },
  );

  it('is on a map with its age, outside the scale', async () => {
    state.snapshot = silent();
    const text = await body('parts/HeatMap.svelte', { metric: metricById('voltage') });
    expect(text.match(/data-last/g)).toHaveLength(96);
    expect(text).toContain('3 min ago');
    expect(text).not.toContain('background-color');
    state.snapshot = half();
    const some = await body('parts/HeatMap.svelte', { metric: metricById('voltage') });
    expect(some.match(/data-last/g)).toHaveLength(12);
    expect(some).toContain('12 of 96 cells, 3 min ago');
    state.snapshot = live96();
    expect(await body('parts/HeatMap.svelte', { metric: metricById('voltage') })).not.toContain('data-last');
  });
});
