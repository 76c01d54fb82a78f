// What a frame draws. All numbers of a snapshot are drawn in one frame: a map, a table and a card never disagree. The
// charts follow in the next one, so that neither is long.

export type Step = 'numbers' | 'charts';

const BEAT_MS = 60; // eyes read no faster
const TICK_MS = 250; // ages grow and charts move on while nothing arrives

export class FrameSchedule {
  private step: Step = 'charts';
  private begunAt = -Infinity;

  /** The step of the frame at `stamp` [ms]; null where it has nothing to draw. */
  next(stamp: number, changed: boolean): Step | null {
    const since = stamp - this.begunAt;
    if (this.step === 'numbers') this.step = 'charts';
    else if (since >= (changed ? BEAT_MS : TICK_MS)) {
      this.step = 'numbers';
      this.begunAt = stamp;
    } else return null;
    return this.step;
  }

  /** How long after the frame at `stamp` nothing is to be drawn [ms]; 0: the next frame has to be asked for. */
  pause(stamp: number, changed: boolean): number {
    if (this.step === 'numbers' || changed) return 0;
    return Math.max(0, this.begunAt + TICK_MS - stamp);
  }
}

// How long a message waited on its way, from two clocks that know nothing of each other: the message that waited
// least shows how they differ, and what another one has above that, it has waited. They may drift apart slowly. A link that
// was cut changes neither clock: the first message after the cut is as old as it is. Another run of the sender's clock,
// of a service that started again or whose computer slept, counts from elsewhere.
const DRIFT = 500e-6;

export class MinimumDelay {
  private offset: number | null = null;
  private run: string | null = null;
  private received = 0;

  /** Seconds that a message waited; `sent` by a run of the sender's clock, `received` by ours, both in seconds. */
  of(run: string | null, sent: number, received: number): number {
    const difference = received - sent;
    if (run !== this.run) this.offset = null;
    this.run = run;
    const drifted =
      this.offset === null ? difference : this.offset + DRIFT * Math.max(0, received - this.received);
    this.offset = Math.min(difference, drifted);
    this.received = received;
    return difference - this.offset;
  }
}
