// A colour scale's limits: always outside the data, round numbers, and steady while the data moves a little.

export interface Scale {
  low: number;
  high: number;
}

export function extent(values: readonly (number | null)[]): Scale | null {
  let low = Infinity;
  let high = -Infinity;
  for (const v of values) {
    if (v === null || !Number.isFinite(v)) continue;
    if (v < low) low = v;
    if (v > high) high = v;
  }
  return low <= high ? { low, high } : null;
}

const step = (span: number): number => {
  const decade = 10 ** Math.floor(Math.log10(span));
  const lead = span / decade;
  return (lead < 2 ? 0.1 : lead < 5 ? 0.25 : 0.5) * decade;
};

/**
 * The scale for `values`: contains them all, is at least `least` wide, ends on round numbers.
 * The previous scale is kept while it still contains the data and is not more than twice too wide.
 */
export function fitScale(
  values: readonly (number | null)[],
  least: number,
  previous: Scale | null,
  symmetric = false,
): Scale {
  const data = extent(values);
  if (!data) return previous ?? { low: 0, high: least };
  if (symmetric) {
    const reach = Math.max(Math.abs(data.low), Math.abs(data.high), least / 2);
    data.low = -reach;
    data.high = reach;
  }
  const missing = least - (data.high - data.low);
  if (missing > 0) {
    data.low -= missing / 2;
    data.high += missing / 2;
  }
  if (previous && previous.low <= data.low && previous.high >= data.high) {
    if (previous.high - previous.low <= 2 * (data.high - data.low)) return previous;
  }
  const grid = step((data.high - data.low) * 1.1);
  const tidy = (x: number): number => Number(x.toPrecision(10));
  return {
    low: tidy(Math.floor(data.low / grid - 1e-9) * grid),
    high: tidy(Math.ceil(data.high / grid + 1e-9) * grid),
  };
}

export const fraction = (value: number, scale: Scale): number =>
  (value - scale.low) / (scale.high - scale.low || 1);

/** At most `most` + 1 round numbers within a range, but two at least. */
export function ticks(low: number, high: number, most: number): number[] {
  const span = high - low;
  if (!(span > 0)) return [low];
  const rough = span / most;
  const decade = 10 ** Math.floor(Math.log10(rough));
  const steps = [10, 5, 2, 1, 0.5, 0.2, 0.1].map((f) => f * decade);
  const widest = steps.findLastIndex((s) => s >= rough * 0.999);
  const step = steps.find((s, i) => i >= widest && within(low, high, s).length > 1)!;
  return within(low, high, step);
}

/** The multiples of `step` within a range. */
function within(low: number, high: number, step: number): number[] {
  const found: number[] = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * (high - low); k++) {
    found.push(Number((k * step).toPrecision(12)));
  }
  return found;
}

/** The step of an axis of `length` pixels: ticks `space` apart at least, or closer where only one would be seen. */
export function stepOf(low: number, high: number, length: number, space: number): number {
  let k = STEPS.findIndex((step) => (step * length) / (high - low) >= space);
  if (k < 0) k = STEPS.length - 1;
  while (k > 0 && within(low, high, STEPS[k]!).length < 2) k--;
  return STEPS[k]!;
}

/** Distances between ticks that are written with one digit: an axis in steps of 2.5 reads 98, 95, 93. */
export const STEPS: readonly number[] = Array.from({ length: 14 }, (_, k) => k - 6).flatMap((decade) =>
  [1, 2, 5].map((f) => Number(`${f}e${decade}`)),
);

/** Decimals with which neighbouring ticks differ. */
export function places(found: readonly number[]): number {
  const gap = found.length > 1 ? Math.abs(found[1]! - found[0]!) : 1;
  return Math.max(0, Math.min(6, Math.ceil(-Math.log10(gap) - 1e-9)));
}
