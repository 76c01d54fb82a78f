import { describe, expect, it } from 'vitest';
import { at, DIVERGING, SEQUENTIAL } from '../src/theme/ramp';
import { fitScale, fraction } from '../src/theme/scale';

const contrast = (a: number, b: number): number => (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);

describe('the ramps', () => {
  it.each([
    ['sequential', SEQUENTIAL],
    ['diverging', DIVERGING],
  ])('%s: text on every step has a contrast of at least 4.5', (_, ramp) => {
    for (const s of ramp) expect(contrast(s.luminance, s.ink === '#fff' ? 1 : 0)).toBeGreaterThanOrEqual(4.5);
  });

  it('the sequential ramp grows lighter all the way, so that it reads without colour', () => {
    for (let i = 1; i < SEQUENTIAL.length; i++)
      expect(SEQUENTIAL[i]!.luminance).toBeGreaterThan(SEQUENTIAL[i - 1]!.luminance);
  });

  it('the middle of the diverging ramp is its lightest step', () => {
    const lightest = Math.max(...DIVERGING.map((s) => s.luminance));
    expect(at(DIVERGING, 0.5).luminance).toBeCloseTo(lightest, 1);
  });
});

describe('fitting a scale', () => {
  it.each([[[3.601, 3.612, null]], [[2.9, 4.2]], [[-12, 31]], [[0.0021, 0.0034]], [[25, 25]]])(
    'never saturates: %j lies inside',
    (values) => {
      const scale = fitScale(values, 0.001, null);
      for (const v of values) {
        if (v === null) continue;
        expect(fraction(v, scale)).toBeGreaterThanOrEqual(0);
        expect(fraction(v, scale)).toBeLessThanOrEqual(1);
      }
    },
  );

  it('is never narrower than the least span, so that noise is not drawn as a difference', () => {
    const scale = fitScale([3.6, 3.6002], 0.02, null);
    expect(scale.high - scale.low).toBeGreaterThanOrEqual(0.02);
  });

  it('stands still while the data moves inside it, and grows when they leave it', () => {
    const first = fitScale([3.6, 3.64], 0.02, null);
    expect(fitScale([3.605, 3.638], 0.02, first)).toBe(first);
    expect(fitScale([3.4, 3.638], 0.02, first).low).toBeLessThanOrEqual(3.4);
  });

  it('shrinks again when the data needs less than half of it', () => {
    const wide = fitScale([3.0, 4.0], 0.02, null);
    expect(fitScale([3.6, 3.64], 0.02, wide).high).toBeLessThan(3.8);
  });

  it('is symmetric on request, so that zero is the middle', () => {
    const scale = fitScale([-3, 21], 20, null, true);
    expect(scale.low).toBe(-scale.high);
  });

  it('keeps the last scale when everything is missing', () => {
    const last = { low: 1, high: 2 };
    expect(fitScale([null, null], 1, last)).toBe(last);
  });
});
