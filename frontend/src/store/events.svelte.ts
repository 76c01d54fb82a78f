// The event log, read again whenever a snapshot names a newer event.

import { get, Problem } from '../link/rest';
import type { LogEvent } from '../link/types';
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
