import { describe, expect, it } from 'vitest';
import { MinimumDelay } from '../src/store/frame_schedule';

describe('the time that a message waited', () => {
  it('is what it has above the quickest', () => {
    const delay = new MinimumDelay();
    expect(delay.of('a', 1000, 7)).toBe(0);
    expect(delay.of('a', 1001, 8.4)).toBeCloseTo(0.4, 2);
    expect(delay.of('a', 1002, 8.99)).toBe(0);
    expect(delay.of('a', 1003, 15)).toBeCloseTo(5.01, 2);
  });

  it('grows with a backlog, message by message', () => {
    const delay = new MinimumDelay();
    let last = 0;
    for (let k = 0; k < 600; k++) last = delay.of('a', k * 0.1, k * 0.11);
    expect(last).toBeCloseTo(5.99, 1);
  });

  it('is nothing for clocks that drift', () => {
    const delay = new MinimumDelay();
    const waited = Array.from({ length: 36000 }, (_, k) => delay.of('a', k * 0.1, k * 0.1 * (1 + 1e-4)));
    expect(Math.max(...waited)).toBeLessThan(0.001);
  });

  it('is known after a cut by what was before it', () => {
    const delay = new MinimumDelay();
    for (let k = 0; k < 60; k++) delay.of('a', 1000 + k, 7 + k + 0.1);
    // cut for two minutes; what comes then was sent a minute after the cut
    expect(delay.of('a', 1120, 187.1)).toBeCloseTo(60, 0);
    expect(delay.of('a', 1181, 188.1)).toBeLessThan(0.1);
  });

  it('begins anew with another run of the clock', () => {
    const delay = new MinimumDelay();
    delay.of('a', 1000, 7);
    expect(delay.of('b', 3, 8)).toBe(0);
    expect(delay.of('b', 4, 9.5)).toBeCloseTo(0.5, 2);
  });
});
