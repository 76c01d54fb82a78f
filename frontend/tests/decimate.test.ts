import { describe, expect, it } from 'vitest';
import { decimate, emptyBand } from '../src/store/decimate';
import { withGaps } from '../src/store/session_readings';

const HOUR = 3600;

describe('decimate', () => {
  it('keeps a dip of 300 ms visible in a view of four hours', () => {
    const n = 4 * HOUR * 10;
    const time = Float64Array.from({ length: n }, (_, i) => i / 10);
    const values = new Float64Array(n).fill(3.9);
    values.fill(2.4, 71_000, 71_003);
    const band = decimate(time, values, 0, 4 * HOUR, 400, 1);
    expect(band.time.length).toBeLessThanOrEqual(400);
    expect(Math.min(...(band.min as number[]))).toBe(2.4);
    expect(band.min.filter((v) => v === 2.4)).toHaveLength(1);
    expect(Math.max(...(band.max as number[]))).toBe(3.9);
  });

  it('gives every sample back when there are fewer samples than buckets', () => {
    const band = decimate([0, 1, 2], [5, 6, 4], 0, 3, 300, 10);
    expect(band.min).toEqual([5, 6, 4]);
    expect(band.max).toEqual([5, 6, 4]);
  });

  it('draws a pause as a gap', () => {
    const band = decimate([0, 0.1, 5, 5.1], [1, 1, 1, 1], 0, 10, 1000, 1);
    expect(band.min).toEqual([1, 1, null, 1, 1]);
    expect(band.time[2]).toBeGreaterThan(0.1);
    expect(band.time[2]).toBeLessThan(5);
  });

  it('draws missing values as missing, and finds the extremes beside them', () => {
    const band = decimate([0, 0.1, 0.2, 1, 1.1], [NaN, 7, 3, NaN, NaN], 0, 2, 2, 10);
    expect(band.min).toEqual([3, null]);
    expect(band.max).toEqual([7, null]);
  });

  it('reuses its output without leaving old rows in it', () => {
    const out = emptyBand();
    decimate([0, 1, 2, 3], [1, 2, 3, 4], 0, 4, 4, 10, out);
    decimate([0], [9], 0, 4, 4, 10, out);
    expect(out).toEqual({ time: [0], min: [9], max: [9] });
  });

  it('leaves out what lies outside the view', () => {
    expect(decimate([0, 1, 2, 3], [1, 2, 3, 4], 1, 3, 10, 10).min).toEqual([2, 3]);
  });
});

describe('withGaps', () => {
  it('puts a hole where the session has one, in the unit of the page', () => {
    const band = withGaps({ time: [0, 1, 9], min: [0.5, 0.4, 0.3], max: [0.5, 0.4, 0.3], unit: '1' }, [
      [1, 9],
    ]);
    expect(band.time).toEqual([0, 1, 5, 9]);
    expect(band.min[2]).toBeNull();
    expect(band.max[0]).toBe(50);
  });

  it('is empty for a signal that was not recorded', () => {
    expect(withGaps(undefined, [[0, 1]]).time).toEqual([]);
  });
});
