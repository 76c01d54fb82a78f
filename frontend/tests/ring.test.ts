import { describe, expect, it } from 'vitest';
import { Ring } from '../src/store/ring';

const filled = (capacity: number, n: number): Ring => {
  const ring = new Ring(capacity, 1);
  for (let i = 0; i < n; i++) ring.push(i, [10 * i]);
  return ring;
};

describe('Ring', () => {
  it('keeps the newest samples in order of time once it is full', () => {
    const { time, values } = filled(5, 13).since(-Infinity);
    expect([...time]).toEqual([8, 9, 10, 11, 12]);
    expect([...values[0]!]).toEqual([80, 90, 100, 110, 120]);
  });

  it.each([0, 1, 3, 5, 6, 9])('is the same as a plain list that forgets its head after %i samples', (n) => {
    const expected = Array.from({ length: n }, (_, i) => i).slice(-5);
    expect([...filled(5, n).since(-Infinity).time]).toEqual(expected);
  });

  it('finds the first sample not older than a time', () => {
    const ring = filled(8, 20);
    expect([...ring.since(17.5).time]).toEqual([18, 19]);
    expect([...ring.since(17).time]).toEqual([17, 18, 19]);
    expect(ring.since(99).length).toBe(0);
  });

  it('stores a missing value as a hole, never as zero', () => {
    const ring = new Ring(3, 2);
    ring.push(1, [null, 5]);
    expect(ring.since(0).values[0]![0]).toBeNaN();
    expect(ring.since(0).values[1]![0]).toBe(5);
  });

  it('ignores a sample that does not advance time', () => {
    const ring = filled(4, 3);
    const before = ring.revision;
    ring.push(2, [999]);
    ring.push(1, [999]);
    expect(ring.length).toBe(3);
    expect(ring.revision).toBe(before);
  });

  it('takes samples again after it was cleared, earlier ones too', () => {
    const ring = filled(4, 9);
    ring.clear();
    ring.push(1, [7]);
    expect([...ring.since(0).time]).toEqual([1]);
  });
});
