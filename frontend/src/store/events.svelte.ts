// The event log, read again whenever a snapshot names a newer event.

import type { BoxList, LogEvent, Session } from '../link/types';
import { get, Problem } from '../link/rest';
import { live } from './live.svelte';

class Events {
  list = $state.raw<LogEvent[]>([]);
  problem = $state.raw<Problem | null>(null);
  loaded = $state(false);
  private newest = -1;
  private busy = false;

  /** Read the log if `lastId` is news; at most one request at a time. */
  async follow(lastId: number): Promise<void> {
    if (this.busy || lastId === this.newest) return;
    this.busy = true;
    try {
      this.list = (await get<{ events: LogEvent[] }>('events?limit=500')).events;
      this.newest = lastId;
      this.problem = null;
    } catch (error) {
      if (!(error instanceof Problem)) throw error;
      this.problem = error;
      this.newest = lastId;
    } finally {
      this.busy = false;
      this.loaded = true;
    }
  }
}

export const events = new Events();

/** Keep the log current while a view shows it; call inside a component's effect. */
export function followEvents(): void {
  void events.follow(live.snapshot?.last_event_id ?? -2);
}

// Where the moment of an event is looked at.
const BOX_WITHIN_S = 60; // a box is written that long after its trip

/** The address of the moment: of its black box, or in its recording; empty where there is neither. */
export function momentOf(
  e: Pick<LogEvent, 'code' | 'cell' | 'time'>,
  boxes: readonly Pick<BoxList['boxes'][number], 'id' | 'cell' | 'time'>[], // newest first
  sessions: readonly Pick<Session, 'id' | 'started' | 'ended' | 'duration_s' | 'recording'>[],
): string {
  if (e.code === 'blackbox') {
    const box = boxes.find((b) => b.cell === e.cell && b.time <= e.time && e.time - b.time < BOX_WITHIN_S);
    return box ? `#/sessions/box/${encodeURIComponent(box.id)}` : '#/sessions/boxes';
  }
  const found = sessions.find(
    (s) =>
      s.started <= e.time &&
      e.time <= (s.recording ? Infinity : (s.ended ?? s.started + (s.duration_s ?? 0))),
  );
  const cell = e.cell === null ? '' : `&cell=${e.cell}`;
  return found ? `#/sessions/${encodeURIComponent(found.id)}?at=${e.time.toFixed(3)}${cell}` : '';
}
