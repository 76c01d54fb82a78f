import { describe, expect, it } from 'vitest';
import type { Car } from '../src/link/types';
import { grown } from '../src/store/fleet.svelte';

const last = { value: 3.7, cell: 4, age_s: 60, since: 1000 };
const car = { state: 'live', age_s: 0.5, last_known: { voltage_min_v: last } } as unknown as Car;

describe('a car between two answers of the service', () => {
  it('grows older', () => expect(grown(car, 1)).toMatchObject({ age_s: 1.5, state: 'live' }));
  it('has last values that grow older, too', () => {
    expect(grown(car, 2).last_known['voltage_min_v']).toEqual({ ...last, age_s: 62 });
    const undated = { ...car, last_known: { soc: { ...last, age_s: null } } };
    expect(grown(undated, 2).last_known['soc']!.age_s).toBeNull();
  });
  it('is late, silent and at last vanished where no answer comes', () => {
    expect(grown(car, 2.5).state).toBe('late');
    expect(grown(car, 9.6).state).toBe('silent');
    expect(grown(car, 10).state).toBe('vanished');
  });
  it('never becomes more than what the service said', () => {
    expect(grown({ ...car, state: 'late' }, 0).state).toBe('late');
    expect(grown({ ...car, state: 'vanished', age_s: 0.1 }, 0).state).toBe('vanished');
    expect(grown({ ...car, age_s: null }, 0)).toMatchObject({ age_s: null, state: 'silent' });
  });
});
