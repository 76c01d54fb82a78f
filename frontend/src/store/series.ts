// A recorded signal as a chart draws it: in the shown unit, with a hole wherever nothing was recorded.

import { displayUnit } from '../format';
import { emptyBand, type Band } from './decimate';

export interface Recorded {
  time: number[];
  min: (number | null)[];
  max: (number | null)[];
  unit: string;
}

export function withGaps(signal: Recorded | undefined, gaps: readonly (readonly [number, number])[]): Band {
  const out = emptyBand();
  if (!signal) return out;
  const { factor } = displayUnit(signal.unit);
  const times = (v: number | null): number | null => (v === null ? null : v * factor);
  let gap = 0;
  signal.time.forEach((time, i) => {
    while (gap < gaps.length && gaps[gap]![1] <= time) {
      const [from, to] = gaps[gap++]!;
      if (out.time.length === 0) continue;
      out.time.push((from + to) / 2);
      out.min.push(null);
      out.max.push(null);
    }
    out.time.push(time);
    out.min.push(times(signal.min[i] ?? null));
    out.max.push(times(signal.max[i] ?? null));
  });
  return out;
}
