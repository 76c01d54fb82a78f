import { describe, expect, it } from 'vitest';
import { besides } from '../src/store/layout';
import { cellIndex } from '../src/format';

describe('besides', () => {
  it('goes through the car as it is built: out, over and back', () => {
    expect(besides(cellIndex(1, 6), 1, 0)).toBe(cellIndex(2, 1));
    expect(besides(cellIndex(1, 1), 0, 1)).toBe(cellIndex(1, 12));
    expect(besides(cellIndex(1, 12), 0, 1)).toBe(cellIndex(8, 1));
  });

  it('ends at the edge of the car', () => {
    expect(besides(cellIndex(1, 1), -1, 0)).toBeNull();
    expect(besides(cellIndex(1, 1), 0, -1)).toBeNull();
    expect(besides(cellIndex(4, 6), 1, 0)).toBeNull();
    expect(besides(cellIndex(8, 12), 0, 1)).toBeNull();
  });

  it('comes back from where it went, everywhere', () => {
    for (let i = 0; i < 96; i++) {
      for (const [dx, dy] of [
        [1, 0],
        [0, 1],
      ] as const) {
        const next = besides(i, dx, dy);
        if (next !== null) expect(besides(next, -dx, -dy)).toBe(i);
      }
    }
  });
});
