// What was just thrown away on a page and can be taken back; nothing of it was sent to a car.

const OFFERED_MS = 20_000;

class Undo {
  offer = $state.raw<{ what: string; back: () => void } | null>(null);
  private timer: ReturnType<typeof setTimeout> | undefined;

  /** Offer to take something back, until the time is over, it is dropped, or something else is offered. */
  let(what: string, back: () => void): void {
    clearTimeout(this.timer);
    this.offer = { what, back };
    this.timer = setTimeout(() => this.drop(), OFFERED_MS);
  }

  take(): void {
    const offer = this.offer;
    this.drop();
    offer?.back();
  }

  drop(): void {
    clearTimeout(this.timer);
    this.offer = null;
  }
}

export const undo = new Undo();
