// Laps of a session against each other and against those of another.

import type { LapFigures } from '../link/types';

/** Index of the quickest lap that counts; of the first where none does; null where there is none. */
export function quickest(laps: readonly Pick<LapFigures, 'lap'>[]): number | null {
  let best: number | null = laps.length ? 0 : null;
  laps.forEach(({ lap }, i) => {
    const before = laps[best!]!.lap;
    if (lap.counts && (!before.counts || lap.end_s - lap.start_s < before.end_s - before.start_s)) best = i;
  });
  return best;
}

/** Values of equal parts of a lap, told for another number of parts. */
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
