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
