// The battery that the service reads: where it comes from, its limits, and whether its master can be written. Asked
// for at each connect; while a session is replayed, cells are counted in that session's.

import { live } from './live.svelte';
import { PAGES, type Page } from './route.svelte';
import { get, Problem } from '../link/rest';
import type { Battery } from '../link/types';
import { Shape, shapes } from './shape.svelte';

const AGAIN_MS = 1000;
const KEY = 'voltwall.battery'; // the last known one: pages without the service are drawn for it, with no value

class CurrentBattery {
  now = $state.raw<Battery | null>(null); // null until the service has answered
  private asked = 0;
  private isKept = false;

  get canWrite(): boolean {
    return this.now?.can_write === true;
  }

  /** The master is the team's own: what only it reports is worth a place. */
  get hasMaster(): boolean {
    return this.now?.source === 'master';
  }

  /** The name of the last known one, null where this browser knows none. */
  get lastName(): string | null {
    return kept()?.name ?? null;
  }

  /** Take the last known one, where the service does not answer. */
  recall(): void {
    if (this.now !== null) return;
    this.now = kept();
    if (this.now === null) return;
    this.isKept = true;
    shapes.live = new Shape(this.now);
  }

  /** Ask until it is known; `replayed` is the session that is shown instead of the live battery. */
  async read(replayed: string | null): Promise<void> {
    const question = ++this.asked;
    if (this.isKept) this.now = null; // the service is here, and may read another
    this.isKept = false;
    while (this.asked === question) {
      try {
        const own = await get<Battery>('battery');
        const shown =
          replayed === null ? own : await get<Battery>(`sessions/${encodeURIComponent(replayed)}/battery`);
        if (this.asked !== question) return;
        this.now = own;
        shapes.live = new Shape(shown);
        localStorage.setItem(KEY, JSON.stringify(own));
        return;
      } catch (error) {
        if (!(error instanceof Problem)) throw error;
        if (error.status === 401) return; // who logs in connects again
        await new Promise((go) => setTimeout(go, AGAIN_MS));
      }
    }
  }
}

/** The battery that this browser knew last, null where it knows none. */
function kept(): Battery | null {
  try {
    const stored = JSON.parse(localStorage.getItem(KEY) ?? 'null') as Battery | null;
    return Array.isArray(stored?.segments) ? stored : null;
  } catch {
    return null;
  }
}

export const battery = new CurrentBattery();

// The pages that there are for what is watched now.
export function pagesNow(): typeof PAGES {
  const needs: Partial<Record<Page, boolean>> = {
    simulator: live.snapshot?.source === 'simulator' && !live.snapshot.replay,
    parameters: battery.now === null || battery.canWrite,
  };
  return PAGES.filter((page) => needs[page.id] ?? true);
}
