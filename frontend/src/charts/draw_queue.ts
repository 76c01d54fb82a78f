// Charts take turns: what many of them have to draw at once is spread over frames, so that none of these is long.

const BUDGET_MS = 6; // of a frame; the rest is the page's

export class DrawQueue {
  private readonly waiting = new Map<object, () => void>();
  private isScheduled = false;

  constructor(
    private readonly nextFrame: (draw: () => void) => void,
    private readonly now: () => number = () => performance.now(),
  ) {}

  /** Draw for `who` when its turn comes; what it asked before and was not drawn yet is replaced. */
  ask(who: object, draw: () => void): void {
    this.waiting.set(who, draw);
    this.call();
  }

  /** Draw what waits for `who` at once: paper does not wait for a frame. */
  hurry(who: object): void {
    const draw = this.waiting.get(who);
    this.waiting.delete(who);
    draw?.();
  }

  forget(who: object): void {
    this.waiting.delete(who);
  }

  private call(): void {
    if (this.isScheduled || this.waiting.size === 0) return;
    this.isScheduled = true;
    this.nextFrame(() => this.draw());
  }

  private draw(): void {
    this.isScheduled = false;
    const until = this.now() + BUDGET_MS;
    for (const [who, draw] of this.waiting) {
      this.waiting.delete(who);
      draw();
      if (this.now() >= until) break;
    }
    this.call();
  }
}
