// Fixed-size history in Float64Arrays: every sample is written twice, so that any window is one view without a copy.

export interface Window {
  time: Float64Array;
  values: Float64Array[];
  length: number;
}

/** A ring of samples with `width` values each; NaN is a missing value. */
export class Ring {
  revision = 0;
  length = 0;
  private next = 0;
  private readonly time: Float64Array;
  private readonly columns: Float64Array[];

  constructor(
    readonly capacity: number,
    readonly width: number,
  ) {
    this.time = new Float64Array(2 * capacity);
    this.columns = Array.from({ length: width }, () => new Float64Array(2 * capacity));
  }

  get lastTime(): number {
    return this.length === 0 ? -Infinity : this.time[this.next + this.capacity - 1]!;
  }

  /** Append one sample; a time that does not advance is ignored. */
  push(time: number, values: ArrayLike<number | null>): void {
    if (time <= this.lastTime) return;
    const at = this.next;
    this.time[at] = this.time[at + this.capacity] = time;
    for (let i = 0; i < this.width; i++) {
      const column = this.columns[i]!;
      column[at] = column[at + this.capacity] = values[i] ?? NaN;
    }
    this.next = (at + 1) % this.capacity;
    this.length = Math.min(this.length + 1, this.capacity);
    this.revision++;
  }

  clear(): void {
    this.length = 0;
    this.next = 0;
    this.revision++;
  }

  /** The samples not older than `from`, as views that the next push may change. */
  since(from: number): Window {
    const end = this.next + this.capacity;
    let low = end - this.length;
    let high = end;
    while (low < high) {
      const middle = (low + high) >>> 1;
      if (this.time[middle]! < from) low = middle + 1;
      else high = middle;
    }
    return {
      time: this.time.subarray(low, end),
      values: this.columns.map((column) => column.subarray(low, end)),
      length: end - low,
    };
  }
}
