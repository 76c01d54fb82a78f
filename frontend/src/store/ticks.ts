/** At most `most` + 1 round numbers within a range. */
export function ticks(low: number, high: number, most: number): number[] {
  const span = high - low;
  if (!(span > 0)) return [low];
  const rough = span / most;
  const decade = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((f) => f * decade).find((s) => s >= rough * 0.999)!;
  const found: number[] = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * span; k++) {
    found.push(Number((k * step).toPrecision(12)));
  }
  return found;
}

/** Distances between ticks that are written with one digit: an axis in steps of 2.5 reads 98, 95, 93. */
export const STEPS: readonly number[] = Array.from({ length: 14 }, (_, k) => k - 6).flatMap((decade) =>
  [1, 2, 5].map((f) => Number(`${f}e${decade}`)),
);

/** Decimals with which neighbouring ticks are told apart. */
export function places(found: readonly number[]): number {
  const gap = found.length > 1 ? Math.abs(found[1]! - found[0]!) : 1;
  return Math.max(0, Math.min(6, Math.ceil(-Math.log10(gap) - 1e-9)));
}
