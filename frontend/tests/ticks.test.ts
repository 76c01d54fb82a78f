import { describe, expect, it } from 'vitest';
import { ticks } from '../src/store/ticks';
import { signed } from '../src/format';

describe('axis ticks', () => {
  it('are round, few and inside', () => {
    expect(ticks(0, 1, 5)).toEqual([0, 0.2, 0.4, 0.6, 0.8, 1]);
    expect(ticks(2.41, 4.2, 4)).toEqual([2.5, 3, 3.5, 4]);
    expect(ticks(-10, 5, 5)).toEqual([-10, -5, 0, 5]);
    expect(ticks(0.0000001, 0.0000009, 4).length).toBeGreaterThan(2);
  });

  it('of a range without width are that one value', () => {
    expect(ticks(3, 3, 5)).toEqual([3]);
  });
});

describe('a difference', () => {
  it('carries its sign, and none where it is missing', () => {
    expect([signed(1.234, 1), signed(-1.234, 1), signed(0, 0), signed(null, 1)]).toEqual([
      '+1.2',
      '−1.2',
      '+0',
      '–',
    ]);
  });
});
