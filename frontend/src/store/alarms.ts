// Which alarms still want a person's attention, and how bad the worst of them is.

import type { Alarm, Maybe, Severity, Snapshot } from '../link/types';

const RANK: Record<Severity, number> = { watch: 0, warning: 1, trip: 2 };

/** Alarms that are active or not yet acknowledged, worst first, newest first among equals. */
export function openAlarms(snapshot: Maybe<Snapshot>): Alarm[] {
  return (snapshot?.alarms ?? [])
    .filter((a) => a.active || !a.acknowledged_by)
    .sort((a, b) => RANK[b.severity] - RANK[a.severity] || b.since - a.since);
}
