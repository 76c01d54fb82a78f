// Laps of a session against each other and against those of another.

import type { LapFigures } from '../link/types';

type Laps = readonly Pick<LapFigures, 'lap'>[];
const timeOf = ({ lap }: Laps[number]): number => lap.end_s - lap.start_s;

/** Index of the quickest lap that counts; null where none does. */
export const quickest = (laps: Laps): number | null =>
  laps.reduce<number | null>(
    (best, each, i) => (each.lap.counts && (best === null || timeOf(each) < timeOf(laps[best]!)) ? i : best),
    null,
  );

/** Indices of the two laps that are compared at first; the first lap begins at a standstill, unlike the others. */
export function compared(laps: Laps): number[] {
  const counted = laps.flatMap(({ lap }, i) => (lap.counts ? [i] : []));
  return counted.slice(counted.length > 2 ? 1 : 0).slice(0, 2);
}

/** Values of equal parts of a lap, resampled to another number of parts. */
export const reparted = <T>(values: readonly T[], parts: number): T[] =>
  Array.from(
    { length: values.length ? parts : 0 },
    (_, i) => values[Math.floor((i * values.length) / parts)]!,
  );

/** Where laps come from, as the address has it; the fields are texts as typed. */
export interface LapSource {
  source: string; // empty: found automatically
  canId: string;
  canByte: string;
  signal: string;
}

const SOURCES = ['markers', 'pattern', 'can', 'signal'];

export function lapSource(query: URLSearchParams): LapSource {
  const source = query.get('source') ?? '';
  return {
    source: SOURCES.includes(source) ? source : '',
    canId: query.get('can-id') ?? '0x310',
    canByte: query.get('can-byte') ?? '0',
    signal: query.get('lap-signal') ?? '',
  };
}

/** What the service is asked for; null where a field is missing or wrong. */
export function askedBy({ source, canId, canByte, signal }: LapSource): string | null {
  if (source === 'can') {
    const [id, byte] = [whole(canId), whole(canByte)];
    return id === null || byte === null || byte > 63 ? null : `source=can&can_id=${id}&can_byte=${byte}`;
  }
  if (source === 'signal') return signal ? `source=signal&lap_signal=${encodeURIComponent(signal)}` : null;
  return source && `source=${source}`;
}

function whole(text: string): number | null {
  const value = text.trim() ? Number(text) : NaN;
  return Number.isInteger(value) && value >= 0 ? value : null;
}
