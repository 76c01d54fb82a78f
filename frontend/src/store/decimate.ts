// Reduction to what a screen can show: each bucket of time keeps its lowest and its highest value.

export interface Band {
  time: number[];
  min: (number | null)[];
  max: (number | null)[];
}

export const emptyBand = (): Band => ({ time: [], min: [], max: [] });

/**
 * Reduce ascending samples in [from, to) to at most `buckets` rows, each with the extremes of its bucket.
 * A pause longer than `gapS` puts a row of nulls between, so that a gap is drawn as a gap. `out` is reused.
 */
export function decimate(
  time: ArrayLike<number>,
  values: ArrayLike<number>,
  from: number,
  to: number,
  buckets: number,
  gapS: number,
  out: Band = emptyBand(),
): Band {
  let n = 0;
  const put = (t: number, low: number | null, high: number | null): void => {
    out.time[n] = t;
    out.min[n] = low;
    out.max[n] = high;
    n++;
  };
  const width = (to - from) / buckets;
  let bucket = -1;
  let low = NaN;
  let high = NaN;
  let at = NaN;
  let previous = NaN;
  const flush = (): void => {
    if (bucket >= 0) put(at, Number.isNaN(low) ? null : low, Number.isNaN(high) ? null : high);
  };
  for (let i = 0; i < time.length; i++) {
    const t = time[i]!;
    if (t < from || t >= to) continue;
    const value = values[i]!;
    const mine = Math.floor((t - from) / width);
    if (mine !== bucket || t - previous > gapS) {
      flush();
      if (t - previous > gapS) put((t + previous) / 2, null, null);
      bucket = mine;
      low = high = value;
      at = t;
    } else if (!(value >= low)) {
      if (!Number.isNaN(value)) {
        low = value;
        if (Number.isNaN(high)) high = value;
      }
    } else if (value > high) {
      high = value;
    }
    previous = t;
  }
  flush();
  out.time.length = out.min.length = out.max.length = n;
  return out;
}
