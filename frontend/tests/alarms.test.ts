import { describe, expect, it } from 'vitest';
import { makeSnapshot } from '../fixtures/snapshot';
import type { Alarm } from '../src/link/types';
import { openAlarms } from '../src/store/alarms';

const alarm = (id: number, over: Partial<Alarm>): Alarm => ({
  ...makeSnapshot('fault', 0, 0, 0).alarms[0]!,
  id,
  ...over,
});
const ids = (alarms: Alarm[]): number[] =>
  openAlarms({ ...makeSnapshot('drive', 0, 0, 0), alarms }).map((a) => a.id);

describe('open alarms', () => {
  it('keeps an alarm that is over until somebody has seen it', () => {
    expect(ids([alarm(1, { active: false })])).toEqual([1]);
    expect(ids([alarm(1, { active: false, acknowledged_by: 'kari' })])).toEqual([]);
  });

  it('keeps an alarm that was seen while it lasts', () => {
    expect(ids([alarm(1, { acknowledged_by: 'kari' })])).toEqual([1]);
  });

  it('puts the worst first, then the newest', () => {
    expect(
      ids([
        alarm(1, { severity: 'watch', since: 9 }),
        alarm(2, { severity: 'trip', since: 1 }),
        alarm(3, { severity: 'trip', since: 5 }),
        alarm(4, { severity: 'warning', since: 7 }),
      ]),
    ).toEqual([3, 2, 4, 1]);
  });

  it('has none before the first snapshot', () => {
    expect(openAlarms(null)).toEqual([]);
  });
});
