import { describe, expect, it } from 'vitest';
import type { Alarm } from '../src/link/types';
import { audibleAlarms, isDue, spokenAlarms } from '../src/store/alert_sound.svelte';

const alarm = (id: number, part: Partial<Alarm> = {}): Alarm => ({
  id,
  code: 'cell-overtemperature',
  severity: 'trip',
  message: { code: 'cell-overtemperature', args: {}, text: 'cell overtemperature' },
  cell: 3,
  value: 61,
  limit: 60,
  unit: 'degC',
  since: 1000 + id,
  active: true,
  acknowledged_by: null,
  ended: null,
  cells: [],
  cause: null,
  ...part,
});

describe('calling', () => {
  it('leaves out what is over, seen, or only to be watched', () => {
    const list = [
      alarm(1),
      alarm(2, { active: false }),
      alarm(3, { acknowledged_by: 'Ida' }),
      alarm(4, { severity: 'watch' }),
      alarm(5, { severity: 'warning' }),
    ];
    expect(audibleAlarms(list).map((a) => a.id)).toEqual([1, 5]);
  });
});

describe('a voice', () => {
  it('names what is new, worst first, and no more than three', () => {
    const list = [1, 2, 3, 4, 5].map((id) => alarm(id));
    expect(spokenAlarms(list, new Set([1])).map((a) => a.id)).toEqual([2, 3, 4]);
    expect(spokenAlarms(list, new Set([1, 2, 3, 4, 5]))).toEqual([]);
  });
});

describe('isDue', () => {
  it('is silent without an alarm', () => {
    expect(isDue([], new Set(), Infinity)).toBe(false);
  });

  it('sounds a new alarm at once, whatever sounded before', () => {
    expect(isDue([alarm(1), alarm(2)], new Set([1]), 0)).toBe(true);
  });

  it('repeats a trip sooner than a warning', () => {
    const trip = [alarm(1)];
    const warning = [alarm(1, { severity: 'warning' })];
    const heard = new Set([1]);
    expect(isDue(trip, heard, 1)).toBe(false);
    expect(isDue(trip, heard, 5)).toBe(true);
    expect(isDue(warning, heard, 5)).toBe(false);
    expect(isDue(warning, heard, 25)).toBe(true);
  });
});
