// What charts with one axis show together: a part of it, and two cursors.

import { within, type Range } from './session_readings';

const LEAST = 1e-4; // of the whole: nothing is seen beyond it
const DIGITS = 3; // of a time in seconds

interface Seen {
  part: Range | null;
  a: number | null;
  b: number | null;
}

/** Where what is seen is written, so that a link shows the same: the address. */
interface Noted {
  readonly here: { readonly query: URLSearchParams };
  note(values: Record<string, string | null>): void;
}

/** In the address all charts of a name share it; without an address it is the chart's own. */
export class ChartView {
  private own = $state.raw<Seen>({ part: null, a: null, b: null });

  constructor(
    private readonly address: Noted | null = null,
    private readonly name = '',
  ) {}

  get a(): number | null {
    return this.seen.a;
  }

  get b(): number | null {
    return this.seen.b;
  }

  /** What is in view of the whole; a part that time has left behind is no part of it any more. */
  range(whole: Range): Range {
    return this.isZoomed(whole) ? this.seen.part! : whole;
  }

  isZoomed(whole: Range): boolean {
    const { part } = this.seen;
    return part !== null && part[1] > whole[0];
  }

  look(range: Range, whole: Range): void {
    const next = within(range, whole);
    if (next[1] - next[0] < LEAST * (whole[1] - whole[0])) return;
    this.see({ part: next[0] <= whole[0] && next[1] >= whole[1] ? null : next });
  }

  /** A first click sets cursor A, a second one B, a third A again. */
  pick(value: number): void {
    if (this.a === null || this.b !== null) this.see({ a: value, b: null });
    else this.see({ b: value });
  }

  clear(): void {
    this.see({ part: null, a: null, b: null });
  }

  private get seen(): Seen {
    if (!this.address) return this.own;
    const { query } = this.address.here;
    const read = (what: string): number | null => {
      const text = query.get(`${what}-${this.name}`);
      return text && Number.isFinite(Number(text)) ? Number(text) : null;
    };
    const [from, to] = [read('from'), read('to')];
    const part: Range | null = from === null || to === null || from >= to ? null : [from, to];
    return { part, a: read('a'), b: read('b') };
  }

  private see(changed: Partial<Seen>): void {
    const seen = { ...this.seen, ...changed };
    if (!this.address) {
      this.own = seen;
      return;
    }
    const { part, a, b } = seen;
    const values = { from: part?.[0] ?? null, to: part?.[1] ?? null, a, b };
    this.address.note(
      Object.fromEntries(
        Object.entries(values).map(([what, value]) => [
          `${what}-${this.name}`,
          value === null ? null : value.toFixed(DIGITS),
        ]),
      ),
    );
  }
}
