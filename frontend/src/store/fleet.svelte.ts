// All cars, asked for once a second. Between two answers, and without any, they grow older.

import { get, Problem } from '../link/rest';
import type { Car, Fleet } from '../link/types';

const PERIOD_MS = 1000;
const LIVE_S = 3; // as the service has it: app/service/mqtt/cars.py
const SILENT_S = 10;

/** A car `elapsedS` after the service reported it: no answer makes a value older, too. */
export function grown(car: Car, elapsedS: number): Car {
  const age_s = car.age_s === null ? null : car.age_s + elapsedS;
  let { state } = car;
  if (state !== 'vanished' && elapsedS >= SILENT_S) state = 'vanished';
  else if (state !== 'vanished' && (age_s === null || age_s >= SILENT_S)) state = 'silent';
  else if (state === 'live' && (age_s ?? Infinity) >= LIVE_S) state = 'late';
  const last_known = Object.fromEntries(
    Object.entries(car.last_known).map(([name, one]) => [
      name,
      { ...one, age_s: one.age_s === null ? null : one.age_s + elapsedS },
    ]),
  );
  return { ...car, age_s, state, last_known };
}

class FleetStore {
  answer = $state.raw<Fleet | null>(null);
  problem = $state('');
  refused = $state(false); // log in first
  elapsedS = $state(0); // since the last answer
  cars = $derived((this.answer?.cars ?? []).map((car) => grown(car, this.elapsedS)));
  /** Seconds since the page received anything from its service, 0 while it does. */
  gone = $derived(this.elapsedS >= LIVE_S ? this.elapsedS : 0);
  private answered = performance.now();

  start(): void {
    void this.read();
    setInterval(() => (this.elapsedS = (performance.now() - this.answered) / 1000), PERIOD_MS / 2);
  }

  private async read(): Promise<void> {
    try {
      const asked = performance.now();
      const abort = AbortSignal.timeout(5 * PERIOD_MS);
      this.answer = await get<Fleet>('fleet', abort);
      this.answered = asked; // its ages are of some time after that, so they are shown no younger
      this.elapsedS = (performance.now() - asked) / 1000;
      this.problem = '';
      this.refused = false;
    } catch (error) {
      this.refused = error instanceof Problem && error.status === 401;
      this.problem = error instanceof Problem ? error.sentence : String(error);
    }
    setTimeout(() => void this.read(), PERIOD_MS);
  }
}

export const fleet = new FleetStore();
