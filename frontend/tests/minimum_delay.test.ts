import { describe, expect, it } from 'vitest';
import { MinimumDelay } from '../src/store/minimum_delay';

describe('the time that a message waited', () => {
  it('is what it has above the quickest', () => {
    const delay = new MinimumDelay();
    expect(delay.of(1000, 7)).toBe(0);
    expect(delay.of(1001, 8.4)).toBeCloseTo(0.4, 2);
    expect(delay.of(1002, 8.99)).toBe(0);
    expect(delay.of(1003, 15)).toBeCloseTo(5.01, 2);
  });

  it('grows with a backlog, message by message', () => {
    const delay = new MinimumDelay();
    let last = 0;
    for (let k = 0; k < 600; k++) last = delay.of(k * 0.1, k * 0.11);
    expect(last).toBeCloseTo(5.99, 1);
  });

  it('is nothing for clocks that drift', () => {
    const delay = new MinimumDelay();
    const waited = Array.from({ length: 36000 }, (_, k) => delay.of(k * 0.1, k * 0.1 * (1 + 1e-4)));
    expect(Math.max(...waited)).toBeLessThan(0.001);
  });

  it('begins anew with another service', () => {
    const delay = new MinimumDelay();
    delay.of(1000, 7);
    delay.reset();
    expect(delay.of(3, 8)).toBe(0);
  });
});
