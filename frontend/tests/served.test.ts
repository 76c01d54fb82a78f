import { describe, expect, it } from 'vitest';
import { rootOf } from '../src/link/root';
import { conditionOf } from '../src/store/served.svelte';

describe('the batteries of one service', () => {
  it('know their own pages by the address', () => {
    expect(rootOf('/')).toBe('/');
    expect(rootOf('/index.html')).toBe('/');
    expect(rootOf('/beside/rear/')).toBe('/beside/rear/');
    expect(rootOf('/beside/rear/assets/x.js')).toBe('/beside/rear/');
  });

  it('are told by their worst alarm, and as silent where no voltage comes', () => {
    const one = { name: 'rear', path: '/beside/rear/', voltage_age_s: 1, worst: null };
    expect(conditionOf(one)).toBeNull();
    expect(conditionOf({ ...one, worst: 'trip', voltage_age_s: null })).toBe('trip');
    expect(conditionOf({ ...one, voltage_age_s: null })).toBe('silent');
    expect(conditionOf({ ...one, voltage_age_s: 90 })).toBe('silent');
  });
});
