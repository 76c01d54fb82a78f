// Something that a page asks of the service: whether it is under way, and why the last try failed.

import { Problem } from '../link/rest';

export class Attempt {
  busy = $state(''); // what is under way
  failed = $state(''); // a sentence in the page's language, until a try succeeds

  /** Try it, and return whether it was done. */
  async run(action: () => Promise<unknown>, what = 'it'): Promise<boolean> {
    this.busy = what;
    try {
      await action();
      this.failed = '';
      return true;
    } catch (error) {
      if (!(error instanceof Problem)) throw error;
      this.failed = error.sentence;
      return false;
    } finally {
      this.busy = '';
    }
  }
}

/** Read now and every so often; return what ends it, for an effect. */
export function every(milliseconds: number, read: () => unknown): () => void {
  void read();
  const timer = setInterval(() => void read(), milliseconds);
  return () => clearInterval(timer);
}
