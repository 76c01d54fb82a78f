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
