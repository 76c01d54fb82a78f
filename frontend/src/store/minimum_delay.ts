// How long a message waited on its way, from two clocks that know nothing of each other: the message that waited
// least shows how they differ, and what another one has above that, it has waited. They may drift apart slowly.

const DRIFT = 500e-6;

export class MinimumDelay {
  private offset: number | null = null;
  private received = 0;

  /** Seconds that a message waited; `sent` by the sender's clock, `received` by ours, both in seconds. */
  of(sent: number, received: number): number {
    const difference = received - sent;
    const drifted =
      this.offset === null ? difference : this.offset + DRIFT * Math.max(0, received - this.received);
    this.offset = Math.min(difference, drifted);
    this.received = received;
    return difference - this.offset;
  }

  /** Begin anew: the sender's clock may be another one. */
  reset(): void {
    this.offset = null;
  }
}
