// What the session viewer computes from recorded bands and events: readings at cursors, alarm spans, windows.

import { displayUnit } from '../format';
import { emptyBand, type Band } from './decimate';
import type { Maybe, SessionEvent, Severity } from '../link/types';

export type Range = readonly [from: number, to: number];

export interface Reading {
  low: number;
  high: number;
}

/** Lowest and highest of a band at an instant: those of the point nearest in time; null in a gap or beyond the ends. */
export function readingAt(band: Band, time: number): Maybe<Reading> {
  const { time: times, min, max } = band;
  if (times.length === 0) return null;
  let low = 0;
  let high = times.length - 1;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle]! < time) low = middle + 1;
    else high = middle;
  }
  if (low > 0 && time - times[low - 1]! < times[low]! - time) low--;
  const step = times.length > 1 ? (times.at(-1)! - times[0]!) / (times.length - 1) : 1;
  if (Math.abs(times[low]! - time) > Math.max(2 * step, 1)) return null;
  const [a, b] = [min[low], max[low]];
  return a === null || a === undefined || b === null || b === undefined ? null : { low: a, high: b };
}

/** Lowest and highest of a band between two instants, null where nothing was recorded between them. */
export function extremesBetween(band: Band, from: number, to: number): Maybe<Reading> {
  let low = Infinity;
  let high = -Infinity;
  band.time.forEach((time, i) => {
    if (time < from || time > to) return;
    const [a, b] = [band.min[i], band.max[i]];
    if (a !== null && a !== undefined && a < low) low = a;
    if (b !== null && b !== undefined && b > high) high = b;
  });
  return low <= high ? { low, high } : null;
}

export interface AlarmSpan {
  code: string;
  severity: Severity;
  message: SessionEvent['message'];
  cell: Maybe<number>;
  from: number;
  to: number; // the end of the session where it never ended
}

const RANK: Record<Severity, number> = { watch: 0, warning: 1, trip: 2 };

const MOMENTARY = new Set(['boot', 'can-rx-timeout']);
const ends = (info: string, code: string): boolean =>
  info === code ||
  (info === 'faults-cleared' && code.startsWith('trip-')) ||
  (info === 'config-stored' && code === 'eeprom-invalid');

/** Alarms as spans: from the event that names one to the info event that ends it; what only happened has no length. */
export function alarmSpans(events: readonly SessionEvent[], end: number): AlarmSpan[] {
  const open = new Map<string, AlarmSpan>();
  const spans: AlarmSpan[] = [];
  for (const e of events) {
    if (e.severity === 'info') {
      for (const [code, span] of open) {
        if (!ends(e.code, code)) continue;
        span.to = e.time;
        open.delete(code);
      }
      continue;
    }
    const span: AlarmSpan = {
      code: e.code,
      severity: e.severity,
      message: e.message,
      cell: e.cell,
      from: e.time,
      to: MOMENTARY.has(e.code) ? e.time : end,
    };
    const before = open.get(e.code);
    if (before) before.to = e.time;
    if (!MOMENTARY.has(e.code)) open.set(e.code, span);
    spans.push(span);
  }
  return spans;
}

/** One row per alarm code, worst first, then in order of appearance. */
export function lanes(spans: readonly AlarmSpan[]): AlarmSpan[][] {
  const rows = new Map<string, AlarmSpan[]>();
  for (const span of spans) rows.set(span.code, [...(rows.get(span.code) ?? []), span]);
  const worst = (row: AlarmSpan[]): number => Math.max(...row.map((s) => RANK[s.severity]));
  return [...rows.values()].sort((a, b) => worst(b) - worst(a) || a[0]!.from - b[0]!.from);
}

/** `range` moved and, where it is wider, cut so that it lies within `whole`. */
export function within(range: Range, whole: Range): Range {
  if (range[1] - range[0] >= whole[1] - whole[0]) return whole;
  const width = range[1] - range[0];
  const from = Math.min(Math.max(range[0], whole[0]), whole[1] - width);
  return [from, from + width];
}

/** A band moved in time, for a session that is laid over another. */
export const shifted = (band: Band, seconds: number): Band => ({
  ...band,
  time: band.time.map((t) => t + seconds),
});

/** The value of a band at a cursor: the middle of what its point holds. */
export function valueAt(band: Band, time: number | null): number | null {
  const reading = time === null ? null : readingAt(band, time);
  return reading && (reading.low + reading.high) / 2;
}

/** Bands in [from, to] as rows of a table: time, then lowest and highest of each; null where one has nothing. */
export function rowsOf(bands: readonly Band[], from: number, to: number): [number, ...(number | null)[]][] {
  const rows = new Map<number, [number, ...(number | null)[]]>();
  bands.forEach((band, k) =>
    band.time.forEach((time, i) => {
      if (time < from || time > to) return;
      const row = rows.get(time) ?? [time, ...Array<null>(2 * bands.length).fill(null)];
      row[1 + 2 * k] = band.min[i] ?? null;
      row[2 + 2 * k] = band.max[i] ?? null;
      rows.set(time, row);
    }),
  );
  return [...rows.values()].sort((a, b) => a[0] - b[0]);
}

// A recorded signal as a chart draws it: in the shown unit, with a hole wherever nothing was recorded.
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
