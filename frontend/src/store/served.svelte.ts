// The batteries that the service reads, where it reads more than one: what ails the others while this one is shown.

import { get, Problem } from '../link/rest';
import { ROOT } from '../link/root';
import type { Served, Severity } from '../link/types';

const EVERY_MS = 2000;
const STALE_S = 60; // the slowest battery tells its cells within 40 s

/** What is told of a battery that is not shown: its worst alarm, or that nothing comes of it. */
export function conditionOf(one: Served): Severity | 'silent' | null {
  if (one.worst) return one.worst;
  return one.voltage_age_s === null || one.voltage_age_s > STALE_S ? 'silent' : null;
}

class ServedBatteries {
  all = $state.raw<Served[]>([]);
  here = $derived(this.all.find((one) => one.path === ROOT) ?? null);
  others = $derived(this.all.filter((one) => one.path !== ROOT));

  private asked = 0;

  /** Ask no more. */
  stop(): void {
    this.asked++;
  }

  /** Ask what is served, at each connect; again and again where it is more than one. */
  async read(): Promise<void> {
    const question = ++this.asked;
    while (this.asked === question) {
      try {
        this.all = await get<Served[]>('batteries');
      } catch (error) {
        if (!(error instanceof Problem)) throw error;
        if (error.status === 401) return; // who logs in connects again
      }
      if (this.all.length === 1) return;
      await new Promise((go) => setTimeout(go, EVERY_MS));
    }
  }
}

export const served = new ServedBatteries();
