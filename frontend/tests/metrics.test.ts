import { describe, expect, it } from 'vitest';
import type { Accumulator, Snapshot } from '../src/link/types';
import { leastDelta, meanOfMeasured, metricById } from '../src/store/metrics';

describe('with cells missing', () => {
  it('compares a cell with the cells that are measured', () => {
    expect(meanOfMeasured([3.6, null, 3.8])).toBeCloseTo(3.7);
    expect(meanOfMeasured([null, null])).toBeNull();
    const snapshot = { cells: { voltage_v: [3.6, null, 3.8] }, accumulator: { voltage_mean_v: null } };
    const found = metricById('deviation').values(snapshot as unknown as Snapshot);
    expect(found.map((mv) => mv && Math.round(mv))).toEqual([-100, null, 100]);
  });

  it('knows the least that the spread can be', () => {
    const of = (voltage_min_v: number | null, voltage_max_v: number | null): number | null =>
      leastDelta({ voltage_min_v, voltage_max_v } as Accumulator);
    expect(of(3.6, 3.75)).toBeCloseTo(150);
    expect(of(null, null)).toBeNull();
    expect(leastDelta(undefined)).toBeNull();
  });
});
