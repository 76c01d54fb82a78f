// The battery that the service reads: where it comes from, its limits, and whether its master can be written. Asked
// for at each connect; while a session is replayed, cells are counted in that session's.

import { get, Problem } from '../link/rest';
import type { Battery } from '../link/types';
import { Shape } from './shape';
import { shapes } from './shapes.svelte';

const AGAIN_MS = 1000;

class CurrentBattery {
  now = $state.raw<Battery | null>(null); // null until the service has told
  private asked = 0;

  get canWrite(): boolean {
    return this.now?.can_write === true;
  }

  /** The master is the team's own: what only it tells is worth a place. */
  get hasMaster(): boolean {
    return this.now?.source === 'master';
  }

  /** Ask until it is known; `replayed` is the session that is shown instead of the live battery. */
  async read(replayed: string | null): Promise<void> {
    const question = ++this.asked;
    while (this.asked === question) {
      try {
        const own = await get<Battery>('battery');
        const shown =
          replayed === null ? own : await get<Battery>(`sessions/${encodeURIComponent(replayed)}/battery`);
        if (this.asked !== question) return;
        this.now = own;
        shapes.live = new Shape(shown);
        return;
      } catch (error) {
        if (!(error instanceof Problem)) throw error;
        if (error.status === 401) return; // who logs in connects again
        await new Promise((go) => setTimeout(go, AGAIN_MS));
      }
    }
  }
}

export const battery = new CurrentBattery();
