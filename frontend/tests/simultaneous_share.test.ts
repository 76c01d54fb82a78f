import { describe, expect, it } from 'vitest';
import { simultaneousShare } from '../src/store/metrics';

describe('the share of cells that are told at once', () => {
  it('is 1 for a master, which tells no ages', () => {
    expect(simultaneousShare(undefined)).toBe(1);
    expect(simultaneousShare([])).toBe(1);
  });

  it('is that of one instant, whenever it was', () => {
    expect(simultaneousShare([0.9, 0.95, 1.0, 0.92])).toBe(1);
    expect(simultaneousShare([0, 0.02, 3, 3.5, 4, 4.5, 5, null])).toBe(0.25);
  });

  it('is one cell of a battery that tells one by one', () => {
    expect(simultaneousShare(Array.from({ length: 72 }, (_, i) => 0.5 * i))).toBeCloseTo(1 / 72);
  });
});
