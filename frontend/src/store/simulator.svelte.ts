// The simulated car: asked once a second while its page is open; `problem` is what went wrong with the last command.

import { call, get, post, Problem, remove } from '../link/rest';
import type { FaultInForce, Simulator } from '../link/types';
import { messageText } from '../words/words.svelte';

const POLL_MS = 1000;

export interface FaultDraft {
  fault: string;
  pack?: number;
  cell?: number;
  value?: number;
  for_s?: number;
}

/** Where a fault in force is cleared. */
export function faultPath(fault: FaultInForce): string {
  const place = [
    typeof fault.pack === 'number' ? `pack=${fault.pack}` : '',
    typeof fault.cell === 'number' ? `cell=${fault.cell}` : '',
  ].filter(Boolean);
  const query = place.join('&');
  return `simulator/faults/${encodeURIComponent(fault.fault)}${query ? `?${query}` : ''}`;
}

/** A problem as one sentence that names the field and its limit. */
function sentence(problem: Problem): string {
  const fields = problem.errors.map((e) => messageText(e.message));
  return fields.length ? fields.join('; ') : problem.sentence;
}

class SimulatedCar {
  now = $state.raw<Simulator | null>(null);
  error = $state('');
  problem = $state(''); // why the last command was not done
  busy = $state(false);
  answeredMs = $state<number | null>(null); // when it last sent its state

  /** Whether what is shown is what it does now. */
  get answers(): boolean {
    return this.error === '';
  }

  /** Whether a command would reach it. */
  get takesCommands(): boolean {
    return this.answers && !this.busy;
  }

  /** Keep asking until the returned closure is called. */
  watch(): () => void {
    let stopped = false;
    let timer = 0;
    const ask = async (): Promise<void> => {
      await this.refresh();
      if (!stopped) timer = window.setTimeout(() => void ask(), POLL_MS);
    };
    void ask();
    return () => {
      stopped = true;
      clearTimeout(timer);
    };
  }

  async refresh(): Promise<void> {
    try {
      this.now = await get<Simulator>('simulator');
      this.error = '';
      this.answeredMs = Date.now();
    } catch (error) {
      if (!(error instanceof Problem)) throw error;
      this.error = error.sentence;
    }
  }

  inject = (draft: FaultDraft): Promise<void> => this.send(() => post('simulator/faults', draft));
  clear = (fault: FaultInForce): Promise<void> => this.send(() => remove(faultPath(fault)));
  clearAll = (): Promise<void> => this.send(() => remove('simulator/faults'));
  setSpeed = (value: number | 'max'): Promise<void> => this.send(() => post('simulator/speed', { value }));
  next = (): Promise<void> => this.send(() => call('simulator/next', { method: 'POST' }));
  unplug = (seconds: number): Promise<void> => this.send(() => post('simulator/unplug', { for_s: seconds }));
  choose = (name: string): Promise<void> => this.send(() => post('simulator/scenario', { name }));

  private async send(action: () => Promise<unknown>): Promise<void> {
    this.busy = true;
    this.problem = '';
    try {
      await action();
      await this.refresh();
    } catch (error) {
      if (!(error instanceof Problem)) throw error;
      this.problem = sentence(error);
    } finally {
      this.busy = false;
    }
  }
}

export const car = new SimulatedCar();
