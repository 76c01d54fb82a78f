// What charts with one axis show together: a part of it, and two cursors.

import { within, type Range } from './session_readings';

const LEAST = 1e-4; // of the whole: nothing is seen beyond it

export class ChartView {
  private part = $state.raw<Range | null>(null);
  a = $state<number | null>(null);
  b = $state<number | null>(null);

  /** What is in view of the whole; a part that time has left behind is no part of it any more. */
  range(whole: Range): Range {
    return this.isZoomed(whole) ? this.part! : whole;
  }

  isZoomed(whole: Range): boolean {
    return this.part !== null && this.part[1] > whole[0];
  }

  look(range: Range, whole: Range): void {
    const next = within(range, whole);
    if (next[1] - next[0] < LEAST * (whole[1] - whole[0])) return;
    this.part = next[0] <= whole[0] && next[1] >= whole[1] ? null : next;
  }

  /** A first click sets cursor A, a second one B, a third A again. */
  pick(value: number): void {
    if (this.a === null || this.b !== null) [this.a, this.b] = [value, null];
    else this.b = value;
  }

  clear(): void {
    this.part = this.a = this.b = null;
  }
}

// eslint-disable-next-line svelte/prefer-svelte-reactivity -- who uses what is not shown
const shared = new Map<string, { view: ChartView; users: number }>();

/** The view of all charts of this name, for as long as one of them is there; without a name, one of its own. */
export function viewOf(name: string | undefined): { view: ChartView; leave: () => void } {
  if (name === undefined) return { view: new ChartView(), leave: () => undefined };
  const found = shared.get(name) ?? { view: new ChartView(), users: 0 };
  found.users++;
  shared.set(name, found);
  return {
    view: found.view,
    leave: () => {
      if (--found.users === 0) shared.delete(name);
    },
  };
}
