import { describe, expect, it } from 'vitest';
import { gestures, zoomedAt } from '../src/charts/gestures';
import { ChartView } from '../src/store/chart_view.svelte';
import { rowsOf, valueAt, type Range } from '../src/store/session_readings';

describe('what is in view', () => {
  const whole: Range = [100, 200];

  it('is the whole until a part is chosen, and again when the part reaches it', () => {
    const view = new ChartView();
    expect(view.range(whole)).toEqual(whole);
    view.look([120, 140], whole);
    expect(view.range(whole)).toEqual([120, 140]);
    view.look([190, 240], whole);
    expect(view.range(whole)).toEqual([150, 200]);
    view.look([0, 300], whole);
    expect(view.isZoomed(whole)).toBe(false);
  });

  it('is the whole once time has left the part behind', () => {
    const view = new ChartView();
    view.look([120, 140], whole);
    expect(view.isZoomed([139, 239])).toBe(true);
    expect(view.range([141, 241])).toEqual([141, 241]);
  });

  it('stands in the address, for all charts of a name and whoever opens the link', () => {
    let query = new URLSearchParams('find-events=relay');
    const address = {
      get here() {
        return { query };
      },
      note(values: Record<string, string | null>) {
        query = new URLSearchParams(query);
        for (const [key, value] of Object.entries(values))
          if (value === null) query.delete(key);
          else query.set(key, value);
      },
    };
    const one = new ChartView(address, 'live');
    one.look([120.25, 140], whole);
    one.pick(130);
    expect(query.toString()).toBe('find-events=relay&from-live=120.250&to-live=140.000&a-live=130.000');
    const two = new ChartView(address, 'live');
    expect([two.range(whole), two.a, two.b]).toEqual([[120.25, 140], 130, null]);
    expect(new ChartView(address, 'cell').isZoomed(whole)).toBe(false);
    two.clear();
    expect(query.toString()).toBe('find-events=relay');
    query = new URLSearchParams('from-live=140&to-live=120&a-live=soon');
    expect([one.isZoomed(whole), one.a]).toEqual([false, null]);
  });

  it('zooms around the place under the pointer', () => {
    expect(zoomedAt([0, 10], 2, 0.5)).toEqual([1, 6]);
    expect(zoomedAt(zoomedAt([0, 10], 2, 0.5), 2, 2)).toEqual([0, 10]);
  });
});

describe('cursors', () => {
  it('are set in turn', () => {
    const view = new ChartView();
    for (const time of [1, 2]) view.pick(time);
    expect([view.a, view.b]).toEqual([1, 2]);
    view.pick(3);
    expect([view.a, view.b]).toEqual([3, null]);
  });

  it('read the middle of a point, and nothing in a gap', () => {
    const band = { time: [0, 1, 2, 3], min: [1, 1, null, 1], max: [3, 3, null, 3] };
    expect(valueAt(band, 1.1)).toBe(2);
    expect(valueAt(band, 2)).toBeNull();
    expect(valueAt(band, null)).toBeNull();
  });
});

it('the data of what is in view are one row a time, with nothing where a line has none', () => {
  const first = { time: [0, 1, 2], min: [1, 2, 3], max: [1, 2, 4] };
  const second = { time: [1, 3], min: [7, 9], max: [8, 9] };
  expect(rowsOf([first, second], 0.5, 3)).toEqual([
    [1, 2, 2, 7, 8],
    [2, 3, 4, null, null],
    [3, null, null, 9, 9],
  ]);
});

describe('hands', () => {
  /** A chart of 100 px for 0 to 10, and what it was told. */
  function chart(zoomed = true) {
    const told: unknown[] = [];
    const heard = new Map<string, (event: never) => void>();
    const node = {
      style: {},
      addEventListener: (name: string, listen: (event: never) => void) => heard.set(name, listen),
    } as unknown as HTMLElement;
    gestures(node, {
      place: () => ({ left: 0, width: 100 }),
      range: () => [0, 10],
      isZoomed: () => zoomed,
      look: (range, isStep) => told.push(['look', range.map((v) => Number(v.toFixed(3))), isStep]),
      whole: () => told.push('whole'),
      pick: (value) => told.push(['pick', value]),
      box: () => undefined,
    });
    const pointer = (type: string, clientX: number, more = {}): void =>
      heard.get(type)!({ type, clientX, button: 0, pointerId: 1, pointerType: 'mouse', ...more } as never);
    return { told, pointer, heard };
  }

  it('choose a part by a drag and set a cursor by a click', () => {
    const { told, pointer } = chart();
    pointer('pointerdown', 60);
    pointer('pointermove', 20);
    pointer('pointerup', 20);
    pointer('pointerdown', 50);
    pointer('pointerup', 50);
    expect(told).toEqual([
      ['look', [2, 6], true],
      ['pick', 5],
    ]);
    pointer('pointerdown', 50);
    pointer('pointerup', 50);
    expect(told.at(-1)).toBe('whole'); // twice
  });

  it('move by a drag with Shift and by one finger, but not what is whole', () => {
    for (const [more, zoomed] of [
      [{ shiftKey: true }, true],
      [{ pointerType: 'touch' }, true],
      [{ pointerType: 'touch' }, false],
    ] as const) {
      const { told, pointer } = chart(zoomed);
      pointer('pointerdown', 50, more);
      pointer('pointermove', 40, more);
      pointer('pointerup', 40, more);
      expect(told).toEqual(zoomed ? [['look', [1, 11], false]] : []);
    }
  });

  it('zoom by two fingers around their middle', () => {
    const { told, pointer } = chart();
    const touch = { pointerType: 'touch' };
    pointer('pointerdown', 40, touch);
    pointer('pointerdown', 60, { ...touch, pointerId: 2 });
    pointer('pointermove', 80, { ...touch, pointerId: 2 });
    expect(told).toEqual([['look', [2.5, 7.5], false]]);
  });
});
