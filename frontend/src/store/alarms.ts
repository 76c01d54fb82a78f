// Which alarms still want a person's attention, how bad the worst of them is, and which cells tripped.

import { clock } from '../format';
import type { Alarm, Maybe, Severity, Snapshot } from '../link/types';
import { t } from '../words/words.svelte';

const RANK: Record<Severity, number> = { watch: 0, warning: 1, trip: 2 };
const MASTER = 'master-fault'; // says that the circuit is open; the other trips say what is beyond a limit

/** Alarms that are active or not yet acknowledged: what holds before what is over, worst first, newest first. */
export function openAlarms(snapshot: Maybe<Snapshot>): Alarm[] {
  return (snapshot?.alarms ?? [])
    .filter((a) => a.active || !a.acknowledged_by)
    .sort(
      (a, b) =>
        Number(b.active) - Number(a.active) || RANK[b.severity] - RANK[a.severity] || b.since - a.since,
    );
}

/** The trips that hold, the master's own first: it is the one that opened the circuit. */
export function activeTrips(snapshot: Maybe<Snapshot>): Alarm[] {
  return openAlarms(snapshot)
    .filter((a) => a.active && a.severity === 'trip')
    .sort((a, b) => Number(b.code === MASTER) - Number(a.code === MASTER));
}

/** Since when it holds, or when it ended. */
export const when = ({ since, ended, active }: Alarm): string =>
  active ? t('since {time}', { time: clock(since) }) : t('ended {time}', { time: clock(ended).slice(0, 5) });

/** Every cell that an alarm is about. */
export const cellsOf = (alarm: Alarm): number[] =>
  alarm.cells.length ? alarm.cells : alarm.cell === null ? [] : [alarm.cell];

/** The cells that the trips which hold are about. */
export const trippedCells = (snapshot: Maybe<Snapshot>): ReadonlySet<number> =>
  new Set(activeTrips(snapshot).flatMap(cellsOf));
