import { afterAll, beforeAll, describe, expect, it } from 'vitest';
import * as f from '../src/format';
import { placeOf } from '../src/store/cell_comparison';
import { shapes } from '../src/store/shape.svelte';

describe('numbers', () => {
  it('shows a missing value as a dash and never as zero', () => {
    for (const missing of [null, undefined, NaN, Infinity]) expect(f.fixed(missing, 2)).toBe('–');
    expect(f.percent(null, 1)).toBe('–');
    expect(f.quantity(null, 'V')).toBe('– V');
    expect(f.age(null)).toBe('–');
    expect(f.duration(null)).toBe('–');
    expect(f.bytes(undefined)).toBe('–');
    expect(f.span(null)).toBe('–');
  });

  it('shows what is over all cells as a bound where one is missing', () => {
    expect(f.bounded(389.04, null, 1)).toBe('389.0');
    expect(f.bounded(null, 340.41, 1)).toBe('≥340.4');
    expect(f.bounded(null, -3.1, 1)).toBe('≤−3.1');
    expect(f.bounded(null, null, 1)).toBe('–');
    expect(f.bounded(undefined, undefined, 1)).toBe('–');
    expect(f.bounded(0, 340.4, 1)).toBe('0.0');
  });

  it('says a length of time in the unit that people would', () => {
    expect([0, 34.4, 89, 90, 150, 3600, 7260, 45_000].map(f.span)).toEqual([
      '0 s',
      '34 s',
      '89 s',
      '2 min',
      '3 min',
      '60 min',
      '2 h 01 min',
      '12 h 30 min',
    ]);
  });

  it('keeps its decimals and uses a true minus, without a negative zero', () => {
    expect(f.fixed(3.7, 3)).toBe('3.700');
    expect(f.fixed(-12.34, 1)).toBe('−12.3');
    expect(f.fixed(-0.04, 1)).toBe('0.0');
  });

  it('shows one count of a field and no more', () => {
    expect([1, 0.1, 0.01, 1e-4, 1e-5, 1 / 255].map(f.decimalsOf)).toEqual([0, 1, 2, 4, 4, 3]);
    expect(f.decimalsOf(1e-5 * 1000)).toBe(2);
  });

  it('writes quantities in the units people read', () => {
    expect(f.quantity(0.043, '1')).toBe('4.3 %');
    expect(f.quantity(57, 'degC')).toBe('57 °C');
    expect(f.quantity(4.2013, 'V')).toBe('4.2013 V');
    expect(f.quantity(0.0021, 'ohm')).toBe('2.10 mΩ');
  });
});

it('an address breaks behind its separators, not within a word', () => {
  expect(f.addressPieces('socket://127.0.0.1:40123')).toEqual(['socket://', '127.0.0.1:', '40123']);
  expect(f.addressPieces('/tmp/volt-a1/can')).toEqual(['/tmp/', 'volt-', 'a1/', 'can']);
  expect(f.addressPieces('COM3')).toEqual(['COM3']);
});

describe('names of cells', () => {
  let end = (): void => undefined;
  beforeAll(() => {
    end = shapes.show({
      segments: Array<number>(8).fill(12),
      drawing: { rows: 2, order: [0, 1, 2, 3, 7, 6, 5, 4], turned: [] },
    });
  });
  afterAll(() => end());

  it('counts packs and cells from one', () => {
    expect(f.cellName(0)).toBe('pack 1, cell 1');
    expect(f.cellName(30)).toBe('pack 3, cell 7');
    expect(f.cellName(95)).toBe('pack 8, cell 12');
    expect(f.cellName(null)).toBe('–');
  });

  it('finds back the index of every cell it names, and a place of its own for each', () => {
    const places = new Set<string>();
    for (let i = 0; i < shapes.here.nCells; i++) {
      expect(f.cellIndex(f.packNumber(i), f.cellNumber(i))).toBe(i);
      places.add(placeOf(i));
    }
    expect(places.size).toBe(96);
  });
});

describe('time', () => {
  it('calls a value stale after one second and blanks it after ten', () => {
    expect([0, 0.99, 1, 9.9, 10, null].map((age) => f.freshness(age))).toEqual([
      'live',
      'live',
      'stale',
      'stale',
      'blank',
      'blank',
    ]);
  });

  it('lets a part that comes seldom live for longer', () => {
    expect([3, 29, 31].map((age) => f.freshness(age, 30))).toEqual(['live', 'live', 'blank']);
    expect([3, 7, 11].map((age) => f.freshness(age, 6))).toEqual(['live', 'stale', 'blank']);
  });

  it('writes ages and durations in words that fit', () => {
    expect([0.04, 3.25, 14.9, 240, 9000].map(f.age)).toEqual(['0.0 s', '3.3 s', '14 s', '4 min', '2 h']);
    expect([59, 61, 3725].map(f.duration)).toEqual(['00:59', '01:01', '1:02:05']);
  });

  it('rounds bytes without ever showing 1000.0', () => {
    expect([812, 1400, 999_960, 8_400_000].map(f.bytes)).toEqual(['812 B', '1.4 kB', '1.0 MB', '8.4 MB']);
  });
});
