import { describe, expect, it } from 'vitest';
import { places, stepOf, STEPS, ticks } from '../src/theme/scale';
import { fixed, signed } from '../src/format';

describe('axis ticks', () => {
  it('are round, few and inside', () => {
    expect(ticks(0, 1, 5)).toEqual([0, 0.2, 0.4, 0.6, 0.8, 1]);
    expect(ticks(2.41, 4.2, 4)).toEqual([2.5, 3, 3.5, 4]);
    expect(ticks(-10, 5, 5)).toEqual([-10, -5, 0, 5]);
    expect(ticks(0.0000001, 0.0000009, 4).length).toBeGreaterThan(2);
  });

  it('are written as what they are, and no two alike', () => {
    for (const step of STEPS) {
      const axis = Array.from({ length: 9 }, (_, k) => Number(((k - 4) * step).toPrecision(12)));
      const texts = axis.map((v) => fixed(v, places(axis)));
      expect(new Set(texts).size).toBe(axis.length);
      expect(texts.map((text) => Number(text.replace('−', '-')))).toEqual(axis.map((v) => v + 0));
    }
    for (const [low, high, most] of [
      [92.3, 100, 3],
      [29.1, 31.4, 5],
      [0, 0.37, 3],
      [-412, 87, 7],
    ] as const) {
      const axis = ticks(low, high, most);
      expect(new Set(axis.map((v) => fixed(v, places(axis)))).size).toBe(axis.length);
    }
  });

  it('are two at least, wherever the range lies', () => {
    for (const most of [2, 3, 5]) {
      for (let k = 0; k < 400; k++) {
        const low = -7 + 0.037 * k;
        const span = 0.01 * 1.05 ** (k % 120);
        expect(ticks(low, low + span, most).length).toBeGreaterThan(1);
      }
    }
  });

  it('of a chart are a line of text apart, and two at least', () => {
    for (let k = 0; k < 400; k++) {
      const low = 3 + 0.0037 * k;
      const high = low + 0.0224 * 1.04 ** (k % 90); // a cell's voltage: 20 mV and room at either end
      const step = stepOf(low, high, 94, 26);
      const seen = Math.floor(high / step + 1e-9) - Math.ceil(low / step - 1e-9) + 1;
      expect(seen).toBeGreaterThan(1);
      expect((94 * step) / (high - low)).toBeGreaterThan(17);
    }
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
