// What a frame draws. A snapshot is spread over three frames, so that none of them is long: numbers, cells, charts.

export type Step = 'numbers' | 'cells' | 'charts';

const BEAT_MS = 60; // eyes read no faster
const TICK_MS = 250; // ages grow and charts move on while nothing arrives

export class FrameSchedule {
  private step: Step = 'charts';
  private begunAt = -Infinity;

  /** The step of the frame at `stamp` [ms]; null where it has nothing to draw. */
  next(stamp: number, changed: boolean): Step | null {
    const since = stamp - this.begunAt;
    if (this.step === 'numbers') this.step = 'cells';
    else if (this.step === 'cells') this.step = 'charts';
    else if (since >= (changed ? BEAT_MS : TICK_MS)) {
      this.step = 'numbers';
      this.begunAt = stamp;
    } else return null;
    return this.step;
  }
}
