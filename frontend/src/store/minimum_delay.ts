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
