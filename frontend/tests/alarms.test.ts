import { describe, expect, it } from 'vitest';
import { makeSnapshot } from '../fixtures/snapshot';
import type { Alarm } from '../src/link/types';
import {
  activeTrips,
  alarmCounts,
  countText,
  mostImportant,
  openAlarms,
  trippedCells,
  when,
} from '../src/store/alarms.svelte';

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

  it('puts what holds before what is over, whatever it is', () => {
    expect(ids([alarm(1, { active: false, since: 9 }), alarm(2, { severity: 'watch', since: 1 })])).toEqual([
      2, 1,
    ]);
  });

  it('has none before the first snapshot', () => {
    expect(openAlarms(null)).toEqual([]);
  });
});

describe('trips', () => {
  const alarms = [
    alarm(1, { code: 'cell-overtemperature', cell: 30, cells: [], since: 9 }),
    alarm(2, { code: 'master-fault', cell: 63, cells: [], since: 1 }),
    alarm(3, { code: 'cell-undervoltage', cell: 5, cells: [], active: false }),
    alarm(4, { code: 'joint-resistance-high', severity: 'warning', cell: 7, cells: [7, 8] }),
  ];
  const snapshot = { ...makeSnapshot('drive', 0, 0, 0), alarms };

  it('puts the reason that opened the circuit first', () => {
    expect(activeTrips(snapshot).map((a) => a.id)).toEqual([2, 1]);
  });

  it('marks the cells of trips that hold, and no others', () => {
    expect([...trippedCells(snapshot)].sort()).toEqual([30, 63]);
  });
});

describe('the count of alarms', () => {
  const seven = [
    alarm(1, { severity: 'trip' }),
    alarm(2, { severity: 'warning' }),
    alarm(3, { severity: 'warning', acknowledged_by: 'kari' }),
    ...[4, 5, 6, 7].map((id) => alarm(id, { severity: id === 4 ? 'trip' : 'warning', active: false })),
  ];

  it('names each severity, and counts none that ended', () => {
    expect(countText(alarmCounts(seven))).toBe('1 trip, 2 warnings');
    expect(alarmCounts(seven).map(({ severity, n }) => [severity, n])).toEqual([
      ['trip', 1],
      ['warning', 2],
    ]);
    expect(countText(alarmCounts([alarm(1, { severity: 'watch' }), alarm(2, { severity: 'trip' })]))).toBe(
      '1 trip, 1 to watch',
    );
  });

  it('is one trip where the circuit is open for a limit that is still broken', () => {
    const why = { code: 'cell-overvoltage', args: {}, text: 'cell overvoltage' };
    const open = alarm(1, {
      code: 'master-fault',
      message: { code: 'master-fault', args: { why }, text: '' },
    });
    const limit = alarm(2, { code: why.code, message: why });
    const other = alarm(3, {
      code: 'cell-overtemperature',
      message: { ...why, code: 'cell-overtemperature' },
    });
    expect(countText(alarmCounts([open, limit]))).toBe('1 trip');
    expect(countText(alarmCounts([open, limit, other]))).toBe('2 trips');
    expect(countText(alarmCounts([limit]))).toBe('1 trip');
    expect(countText(alarmCounts([open, limit], [limit]))).toBe('2 trips'); // of another car
  });

  it('is empty where nothing holds', () => {
    expect(countText(alarmCounts([alarm(1, { active: false })]))).toBe('');
  });

  it('never cuts a trip that holds, seen or not', () => {
    const listed = [
      ...[1, 2, 3, 4].map((id) => alarm(id, { severity: 'warning', active: id > 1 })),
      alarm(5, { severity: 'trip', acknowledged_by: 'kari' }),
    ];
    expect(mostImportant(listed, 3).map((a) => a.id)).toEqual([5, 2, 3]);
    const trips = [1, 2, 3, 4].map((id) => alarm(id, { severity: 'trip' }));
    expect(mostImportant([...trips, alarm(5, { severity: 'warning' })], 3).map((a) => a.id)).toEqual([
      1, 2, 3, 4,
    ]);
  });
});

describe('the time of an alarm', () => {
  const at = new Date(2026, 10, 21, 10, 36, 58).getTime() / 1000;

  it('is since when it holds, then when it ended', () => {
    expect(when(alarm(1, { since: at }))).toBe('since 10:36:58');
    expect(when(alarm(1, { since: at, active: false, ended: at + 40 }))).toBe('cleared 10:37');
  });
});
