import { describe, expect, it } from 'vitest';
import { ahead, DASH } from '../src/format';
import { firstTrip } from '../src/store/prediction';

describe('what lies ahead', () => {
  it('names the limit that is met first', () => {
    const trips = [
      { limit: 'v_min', seconds: 40, low_s: 31, high_s: 52, cell: 3, beyond_measured: null },
      {
        limit: 'temperature_max',
        seconds: null,
        low_s: null,
        high_s: null,
        cell: null,
        beyond_measured: null,
      },
      { limit: 'soc_min', seconds: 12, low_s: 9, high_s: null, cell: 7, beyond_measured: null },
    ] as const;
    expect(firstTrip(trips)?.limit).toBe('soc_min');
  });

  it('has no first limit when none is near', () => {
    expect(
      firstTrip([
        { limit: 'v_min', seconds: null, low_s: 3000, high_s: null, cell: null, beyond_measured: null },
      ]),
    ).toBeNull();
    expect(firstTrip([])).toBeNull();
  });

  it('never rounds the time left up', () => {
    expect(ahead(59.9)).toBe('59 s');
    expect(ahead(119.9)).toBe('1 min');
    expect(ahead(-1)).toBe('0.0 s');
  });

  it('tells "not within an hour" from "unknown"', () => {
    expect(ahead(null)).toBe('> 1 h');
    expect(ahead(undefined)).toBe(DASH);
  });

  it('keeps to its six characters', () => {
    for (let s = 0; s < 7200; s += 0.7) expect(ahead(s).length).toBeLessThanOrEqual(6);
  });
});
